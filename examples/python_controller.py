"""A controller in Python flies the glider: it dives, climbs and spirals between two depths.

The simulation calls it every half second of simulated time with what the vehicle knows, and moves
the parts towards the positions that it answers.
"""

import math

import twin

SHALLOW, DEEP = 10.0, 60.0


class Porpoise:
    """Dive to DEEP, climb to SHALLOW, and so on, in a slow turn."""

    diving = True

    def __call__(self, seen: twin.Observation) -> twin.Command:
        """Battery forward and pump in for a dive, the other way round for a climb."""
        if seen.depth > DEEP:
            self.diving = False
        elif seen.depth < SHALLOW:
            self.diving = True
        sign = 1.0 if self.diving else -1.0
        turn = math.radians(10.0)
        return twin.Command(shift=0.02 * sign, pump=-290.0 * sign, rotation=turn)


run = twin.simulate(controller=Porpoise(), duration=3600.0, current="uniform:0.1,0")
print(f"deepest {run['true_depth'].max():.1f} m")
print(f"turned to {run['true_heading'][-1]:.0f} degree after an hour")
run.plot("track_3d").savefig("python_controller.png", dpi=200)
