"""Cruise: a control task for one vehicle or many, in dm_control, Gymnasium and its vectors."""

from twin import control
from twin.control import rewards
from twin.control.environment import build
from twin.control.physics import Physics
from twin.control.task import Episode, GliderTask, Reference, row
from twin.vehicle.vehicle import load_vehicle


class Cruise(GliderTask):
    """Formulas take arrays: of many vehicles, goals and measurements have one value each."""

    goals = {"target_speed": ()}  # attributes that an episode sets, with their shapes
    goal_scales = {"to_target": 0.1}  # usual sizes of observations [m/s]

    def draw_episode(self, random):
        start = self.gliding_start(depth=50.0, heading=0.0, pitch=-self.cruise_pitch)
        target = self.cruise.speed * random.uniform(0.5, 1.0)
        return Episode(start=start, goal={"target_speed": target})

    def error(self, physics):
        return self.target_speed - physics.speed()

    def observe_goal(self, physics):
        return {"to_target": row(self.error(physics))}

    def get_reward(self, physics):
        return rewards.tolerance(self.error(physics), bounds=(-0.01, 0.01), margin=0.2)

    def reference(self, physics):  # what an autopilot would fly; optional
        share = float(self.target_speed / self.cruise.speed)
        return Reference(
            pitch=-share * self.cruise_pitch, heading=None, net_mass=share**2 * self.cruise_mass
        )


@control.register
def cruise(vehicle="glider", *, random=None, time_limit=300.0, environment_kwargs=None):
    """Dive at a random speed through the water."""
    glider = load_vehicle(vehicle)
    task = Cruise(glider, max_depth=300.0, random=random)
    physics = Physics.from_vehicle(glider)
    return build(physics, task, time_limit=time_limit, settings=environment_kwargs)
