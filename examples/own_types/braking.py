"""Guidance with a command of one's own beside it: the airbrake opens below 20 m."""

import twin
from twin.mission.controller import MissionController

vehicle = twin.load_vehicle("own.xml")
guidance = MissionController(twin.load_mission("default"), vehicle)


def brake_below_twenty_metres(observation):
    out = float(observation.depth > 20.0)
    return twin.Command(**{**guidance(observation), "airbrake": out})


scenario = twin.Scenario(vehicle=vehicle, duration=300.0)
run = twin.Simulation(scenario).run(brake_below_twenty_metres)
print(f"airbrake out to {run['true_airbrake'].max():.2f}")
