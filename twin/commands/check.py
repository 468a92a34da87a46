"""`twin check`: MuJoCo against Fossen, and both against the published figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from twin.cli.console import Console, JsonOption


@dataclass(frozen=True, kw_only=True)
class Check(JsonOption):
    """Fly random manoeuvres in both models and recompute the published glides."""

    vehicle: str = "glider"
    """shipped vehicle name, or the path of an MJCF file, for the manoeuvres"""
    manoeuvres: int = 20
    """number of random 600 s manoeuvres"""
    seed: int = 0
    """first seed"""
    timestep: float | None = None
    """MuJoCo's physics step in the manoeuvres [s]; default: the vehicle file's"""

    def run(self, console: Console) -> int:
        """Compare; exit code 1 when a limit is exceeded."""
        from twin.checks import agreement as check
        from twin.checks.published import ANGLES
        from twin.errors import InputError
        from twin.vehicle.vehicle import load_vehicle

        if self.manoeuvres < 1:
            raise InputError(f"--manoeuvres must be at least 1, not {self.manoeuvres}")
        if self.seed < 0:
            raise InputError(f"--seed must be 0 or more, not {self.seed}")
        vehicle = load_vehicle(self.vehicle)
        rows, broken = [], []
        published = check.check_published()
        for glide, model, trim in published:
            violations = glide.violations(trim)
            broken += [f"{glide.vehicle}, {glide.source}, {model}: {v}" for v in violations]
            found = glide.differences(trim)
            rows.append(
                {
                    "vehicle": glide.vehicle,
                    "published in": glide.source,
                    "model": model,
                    "speed m/s": trim.speed_m_s,
                    "off by": found["speed"],
                    "pitch deg": trim.pitch_deg,
                    "off by deg": max(
                        (found[n] for n in ANGLES if n in found), key=abs, default=0.0
                    ),
                    "ok": "no" if violations else "yes",
                }
            )
        console.table(rows, title="Published glides (largest angle difference of each)")
        differences = check.check_manoeuvres(
            vehicle, count=self.manoeuvres, seed=self.seed, timestep=self.timestep
        )
        broken += [f"manoeuvre {d.seed} exceeds a limit" for d in differences if not d.ok]
        largest = {
            name: max(getattr(d, name) for d in differences)
            for name in ("speed_m_s", "attitude_deg", "position_percent")
        }
        limits = {
            "speed_m_s": check.SPEED_LIMIT,
            "attitude_deg": check.ATTITUDE_LIMIT,
            "position_percent": check.POSITION_LIMIT,
        }
        console.say()
        console.table(
            [
                {"largest difference": name, "measured": largest[name], "limit": limits[name]}
                for name in largest
            ],
            title=f"MuJoCo against Fossen, {len(differences)} manoeuvres of "
            f"{check.DURATION:.0f} s in sheared current",
        )
        console.answer(
            **largest,
            limits=limits,
            manoeuvres=[asdict(d) for d in differences],
            published=[
                {"vehicle": g.vehicle, "source": g.source, "model": m, **g.differences(t)}
                for g, m, t in published
            ],
            ok=not broken,
        )
        for text in broken:
            console.warn(text)
        console.say("all within the limits" if not broken else f"{len(broken)} beyond the limits")
        return 1 if broken else 0
