"""My logs: a type of log for `factory import mine log.csv`."""

from factory.importing import (
    EMPTY,
    NO_FIXES,
    Channel,
    DeploymentLog,
    Importer,
    WrongFormat,
    read_table,
    register,
    tidy,
)


def read(paths, options, tally):
    logs = []
    for path in paths:
        table = read_table(path)
        if not table.has("my_depth", "my_pitch"):
            raise WrongFormat(path, table.columns)
        time, columns = tidy(table.columns["time"], table.columns, path.name, tally)
        channels = {
            "measured_depth": Channel(time, columns["my_depth"]),
            "measured_pitch": Channel(time, columns["my_pitch"]),
        }
        logs.append(
            DeploymentLog(
                deployment=path.stem,
                platform="my glider",
                channels=channels,
                fixes=NO_FIXES,
                magnetic_variation=EMPTY,
                files=(path.name,),
            )
        )
    return logs


register(
    Importer(
        name="mine",
        vehicle="my glider",
        files="csv",
        channels="depth, pitch",
        period=5.0,
        suffixes=frozenset({".csv"}),
        marks=frozenset({"my_depth", "my_pitch"}),
        read=read,
    )
)
