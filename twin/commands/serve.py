"""`twin serve`: one vehicle as a process that ArduPilot, or what speaks its protocol, drives."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from twin.cli.console import Console, JsonOption
from twin.cli.durations import Seconds


@dataclass(frozen=True, kw_only=True)
class Serve(JsonOption):
    """Fly one vehicle for a client: servo pulses in by UDP, its state out as JSON, as ArduPilot's
    SITL expects of its physics. Ctrl-C ends it and writes what was flown.

    Examples:

        twin serve --vehicle remus --channels propeller,rudder,elevator
        twin serve --vehicle tethys --mavlink udpout:127.0.0.1:14550 --out run.zarr
    """

    vehicle: str = "remus"
    """shipped vehicle name, or the path of an MJCF file"""
    channels: Annotated[str | None, tyro.conf.arg(metavar="PART[,PART ...]")] = None
    """which part each servo channel moves, from channel 1 on [default: the vehicle's parts in the
    order of its file]; 1500 us is rest, 1000 and 2000 us are the ends of the travel"""
    current: str = "none"
    """current, as in `twin simulate`"""
    floor: str = "none"
    """sea floor, as in `twin simulate`; its distance is sent as rng_1"""
    start: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[,TIME]")] = None
    """where and when it begins, as in `twin simulate`"""
    duration: Seconds = 86400.0
    """vehicle's time after which it ends, such as 3600 (seconds) or 6h"""
    host: str = "127.0.0.1"
    """address to serve on"""
    port: int = 9002
    """UDP port; ArduPilot's is 9002"""
    exposed_to: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS[,ADDRESS ...]")] = None
    """with a --host that other machines reach: who may drive, such as 192.168.1.20 or
    192.168.1.0/24. The protocol has no token: whoever sends from there, or with such a false
    address, drives the vehicle"""
    silence: Seconds = 2.0
    """seconds without a packet after which the client is lost and the vehicle flies its failsafe"""
    mavlink: str | None = None
    """send MAVLink telemetry there too, such as udpout:127.0.0.1:14550"""
    out: Path | None = None
    """write what was flown to this zarr store"""
    overwrite: bool = False
    """replace an existing store"""

    def run(self, console: Console) -> int:
        """Serve, and store what was flown."""
        import twin
        from twin.extras import require
        from twin.records import check_target, dataset_of, write_store
        from twin.serve import ArduPilotServer, Channels, MavlinkTelemetry, SteppedVehicle

        if self.out is not None:
            check_target(self.out, overwrite=self.overwrite)
        if self.mavlink is not None:
            require("pymavlink", extra="ardupilot", purpose="--mavlink")
        scenario = twin.scenario_of(
            vehicle=self.vehicle,
            current=self.current,
            floor=self.floor,
            start=self.start,
            duration=self.duration,
            commanded=True,
        )
        flown = SteppedVehicle(scenario)
        named = [] if self.channels is None else self.channels.split(",")
        channels = Channels.of(scenario.vehicle, named)
        place = scenario.place
        telemetry = None
        if self.mavlink is not None:
            telemetry = MavlinkTelemetry(self.mavlink, (place.latitude_deg, place.longitude_deg))
        with ArduPilotServer(
            flown, channels, host=self.host, port=self.port, silence=self.silence,
            exposed_to=[] if self.exposed_to is None else self.exposed_to.split(","),
            telemetry=telemetry, tell=console.note,
        ) as server:  # fmt: skip
            where = "{}:{}".format(*server.address)
            parts = ", ".join(f"{k} {name}" for k, name in enumerate(channels.parts, 1))
            console.note(f"{scenario.vehicle.name} waits on {where}; channels: {parts}")
            try:
                server.run()
            except KeyboardInterrupt:
                console.note("interrupted")
        if telemetry is not None:
            telemetry.close()
        if self.out is not None and flown.time > 0.0:
            trajectory = flown.trajectory()
            write_store(
                dataset_of([trajectory], attributes=trajectory.provenance),
                self.out,
                overwrite=self.overwrite,
            )
        figures = {"flown_s": flown.time, **asdict(server.served)}
        console.pairs({**figures, **({"store": str(self.out)} if self.out else {})})
        console.answer(vehicle=scenario.vehicle.name, out=self.out, **figures)
        return 0
