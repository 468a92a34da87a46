"""One glider flies a mission in a current off the Porcupine Bank, and we draw what happened.

The start says where on Earth the glider is. The density follows from it, and the store holds it.
"""

import twin

mission = twin.Mission(
    name="two dives to the north-east",
    segments=(
        twin.SawTooth(max_depth_m=100, pitch_deg=30, heading_deg=45, yos=2),
        twin.Surface(duration_s=300),
    ),
)

# The wind blows towards the east. Its current turns and fades with depth, beside a tide.
run = twin.simulate(
    mission=mission,
    start={"latitude": 51.5, "longitude": -14.2, "time": "2003-08-01T06:00"},
    current="ekman:tau=0.1,direction=90+tide:m2=0.15,direction=20",
    density="thermocline",
    sensors="field",
    seed=1,
)

# Dead reckoning through the water misses what the current adds.
latitude, longitude = run.geographic_position()
print(run)
end = run.to_xarray()["datetime"].values[-1]
print(f"ended at {latitude[-1]:.4f} N, {longitude[-1]:.4f} E, {end}")
drift = run.position[-1, :2] - run.track_through_water()[-1]
print(f"the water carried it {drift[0]:.0f} m north and {drift[1]:.0f} m east")

run.save("mission.zarr", overwrite=True)
run.plot().savefig("mission_in_a_current.png")
