"""`twin serve`: run one vehicle as a server that ArduPilot (or a client with its protocol) or
ROS 2 drives."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from glider_twin_protocols.kinds import PLUGIN
from twin.cli import Console, Ended, JsonOption, Seconds, require
from twin.errors import InputError

if TYPE_CHECKING:
    from twin import SteppedVehicle

LOOPBACK = "127.0.0.1"
OF_ARDUPILOT = ("channels", "frame", "exposed_to")
OF_ROS2 = ("router", "token_file", "domain", "keys", "rate")
"""Options of one protocol, which are refused with the other"""


@dataclass(frozen=True, kw_only=True)
class Serve(JsonOption):
    """Simulate one vehicle for a client: ArduPilot's SITL sends servo pulses by UDP and receives
    the state as JSON; ROS 2 sends and receives messages over Zenoh. Ctrl-C ends the simulation and
    writes the flight.

    Examples:

        twin serve --vehicle remus --channels propeller,rudder,elevator
        twin serve --vehicle bluerov2 --frame vectored-6dof
        twin serve --vehicle tethys --mavlink udpout:127.0.0.1:14550 --out run.zarr
        twin serve --vehicle remus --protocol ros2 --router tcp/127.0.0.1:7447
    """

    protocol: Literal["ardupilot", "ros2"] = "ardupilot"
    """protocol of the client: ArduPilot's JSON interface, or ROS 2 over Zenoh in real time"""
    vehicle: str = "remus"
    """shipped vehicle name, or the path of an MJCF file"""
    channels: Annotated[str | None, tyro.conf.arg(metavar="PART[,PART ...]")] = None
    """parts that the servo channels move, from channel 1 on [default: the vehicle's parts in the
    order of its file]; 1500 us is rest, 1000 and 2000 us are the ends of the travel"""
    frame: Annotated[str | None, tyro.conf.arg(metavar="{vectored,vectored-6dof}")] = None
    """channels are the motors of this frame of ArduSub, six or eight thrusters, and 1100 and 1900
    us are full thrust; leave MOTx_DIRECTION at 1"""
    current: str = "none"
    """current, as in `twin simulate`"""
    floor: str = "none"
    """sea floor, as in `twin simulate`; its distance is sent as rng_1"""
    start: Annotated[str | None, tyro.conf.arg(metavar="LAT,LON[,TIME]")] = None
    """place and time of the start, as in `twin simulate`"""
    duration: Seconds = 86400.0
    """simulated time after which the flight ends, such as 3600 (seconds) or 6h"""
    host: str = LOOPBACK
    """address to serve on"""
    port: int | None = None
    """port [default: UDP 9002, ArduPilot's, or TCP 7447, Zenoh's]"""
    router: str | None = None
    """ros2: connect to this router, such as tcp/127.0.0.1:7447, instead of listening"""
    token_file: Path | None = None
    """ros2: file with the password of the user twin, which Zenoh's clients must then give; required
    for a --host that other machines can reach"""
    domain: int | None = None
    """ros2: ROS_DOMAIN_ID [default: 0]"""
    keys: Literal["rmw_zenoh", "ros2dds"] | None = None
    """ros2: name topics as rmw_zenoh does, or as zenoh-bridge-ros2dds [default: rmw_zenoh]"""
    rate: float | None = None
    """ros2: messages per second [default: one per control period of the vehicle]"""
    exposed_to: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS[,ADDRESS ...]")] = None
    """clients that may drive, required for a --host that other machines can reach, such as
    192.168.1.20 or 192.168.1.0/24. The protocol has no token: a sender with a forged address can
    drive the vehicle too"""
    silence: Seconds = 2.0
    """seconds without a packet after which the client is lost and the vehicle flies its failsafe"""
    mavlink: str | None = None
    """also send MAVLink telemetry to this address, such as udpout:127.0.0.1:14550"""
    out: Path | None = None
    """write the flight to this zarr store"""
    overwrite: bool = False
    """replace an existing store"""

    def run(self, console: Console) -> int:
        """Serve, and store the flight."""
        import twin
        from glider_twin_protocols import MavlinkTelemetry
        from twin import SteppedVehicle
        from twin.records import check_target, dataset_of, write_store

        self._check_options()
        if self.out is not None:
            check_target(self.out, overwrite=self.overwrite)
        if self.mavlink is not None:
            require("pymavlink", extra=PLUGIN, purpose="--mavlink")
        if self.protocol == "ros2":
            for package in ("zenoh", "rosbags"):
                require(package, extra=PLUGIN, purpose="--protocol ros2")
        scenario = twin.scenario_of(
            vehicle=self.vehicle, current=self.current, floor=self.floor, start=self.start,
            duration=self.duration, commanded=True,
        )  # fmt: skip
        flown = SteppedVehicle(scenario)
        start = (scenario.place.latitude_deg, scenario.place.longitude_deg)
        telemetry = MavlinkTelemetry(self.mavlink, start) if self.mavlink is not None else None
        serve = self._ros2 if self.protocol == "ros2" else self._ardupilot
        served, ended = serve(console, flown, start, telemetry)
        if telemetry is not None:
            telemetry.close()
        if self.out is not None and flown.time > 0.0:
            trajectory = flown.trajectory()
            dataset = dataset_of([trajectory], attributes=trajectory.provenance)
            write_store(dataset, self.out, overwrite=self.overwrite)
        figures = {"flown_s": flown.time, **asdict(served)}
        console.pairs({**figures, **({"store": str(self.out)} if self.out else {})})
        console.answer(vehicle=scenario.vehicle.name, out=self.out, **figures)
        if ended is not None:  # the program's exit code tells of a signal
            raise Ended(f"{flown.time:g} s were flown{f', in {self.out}' if self.out else ''}")
        return 0

    def _check_options(self) -> None:
        for name in OF_ROS2 if self.protocol == "ardupilot" else OF_ARDUPILOT:
            if getattr(self, name) is not None:
                other = "ros2" if self.protocol == "ardupilot" else "ardupilot"
                option = name.replace("_", "-")
                raise InputError(f"--{option} is of --protocol {other}, not of {self.protocol}")
        if self.router is not None and (self.port is not None or self.host != LOOPBACK):
            raise InputError(
                "--router connects to a router: leave out --host and --port, where it would listen "
                "without one"
            )

    def _ardupilot(
        self, console: Console, flown: SteppedVehicle, _: tuple[float, float], telemetry: Any
    ) -> Any:
        from glider_twin_protocols import ArduPilotServer, Channels

        named = [] if self.channels is None else self.channels.split(",")
        if self.frame is not None and named:
            raise InputError("--frame has its own channels: leave out --channels")
        channels = Channels.of(flown.vehicle, named)
        if self.frame is not None:
            channels = Channels.of_frame(flown.vehicle, self.frame)
        with ArduPilotServer(
            flown, channels, host=self.host, port=9002 if self.port is None else self.port,
            silence=self.silence, telemetry=telemetry, tell=console.note,
            exposed_to=[] if self.exposed_to is None else self.exposed_to.split(","),
        ) as server:  # fmt: skip
            where = "{}:{}".format(*server.address)
            parts = ", ".join(f"{k} {name}" for k, name in enumerate(channels.parts, 1))
            console.note(f"{flown.vehicle.name} waits on {where}; channels: {parts}")
            return _until_interrupted(server, console)

    def _ros2(
        self, console: Console, flown: SteppedVehicle, start: tuple[float, float], telemetry: Any
    ) -> Any:
        from glider_twin_protocols import ZenohServer

        port = 7447 if self.port is None else self.port
        with ZenohServer(
            flown, start, host=self.host, port=port, router=self.router, token=self._token(),
            domain=self.domain or 0, bridge=self.keys == "ros2dds", rate=self.rate,
            silence=self.silence, telemetry=telemetry,
        ) as server:  # fmt: skip
            where = self.router or f"tcp/{self.host}:{port}"
            names = ", ".join(f"/commanded/{part.name}" for part in flown.vehicle.parts)
            console.note(f"{flown.vehicle.name} waits on {where}; topics: {names}")
            return _until_interrupted(server, console)

    def _token(self) -> str | None:
        if self.token_file is None:
            return None
        try:
            token = self.token_file.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"--token-file {self.token_file}: {error}") from error
        if not token or any(mark.isspace() or mark == ":" for mark in token):
            raise InputError(
                f"--token-file {self.token_file}: a token is one word without a colon, such as "
                "python -c 'import secrets; print(secrets.token_urlsafe())' writes"
            )
        return token


def _until_interrupted(server: Any, console: Console) -> tuple[Any, Ended | None]:
    """Run a server; returns its counts, and the signal that ended it if it was not Ctrl-C."""
    ended = None
    try:
        server.run()
    except Ended as error:
        ended = error
    except KeyboardInterrupt:
        console.note("interrupted")
    return server.served, ended
