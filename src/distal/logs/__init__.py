"""Read, check and write logs, which are time series of sensor readings.

In: a file, a folder or a frame, and the rig that names its columns; out: a `Log` in SI, with what
was left out said in warnings. Every reading passes one conversion, v = sign (raw · unit) − offset.

    import distal

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    distal.write_log(distal.simulate(rig, scenario, seed=1), rig, "log.csv")
    log = distal.read_log("log.csv", rig)
    print(len(log), list(log.channels))
"""

from distal.logs.formats.registry import TABLES, check_format, file_of
from distal.logs.log import (
    FROM_SENSOR,
    LARGEST_READING,
    Log,
    TruthKind,
    TruthSource,
    check_unit,
    earlier,
    frozen,
    held_samples,
    jumps_away,
    said_of_jumps,
    true_angles,
    true_torques,
)
from distal.logs.log_files import (
    read_angles,
    read_log,
    read_truth,
    write_columns,
    write_log,
)
from distal.logs.messages import MessageReader
from distal.logs.output_files import (
    check_outputs,
    shown,
    write_together,
    write_whole,
)
from distal.logs.raw_to_si import Limits, RawToSI, Remark, decoded, says_nothing
from distal.logs.table_cells import Column, header, name_and_unit
from distal.logs.tables import (
    Episode,
    Source,
    episodes_of,
    open_table,
    read_table,
    sources_of,
)

__all__ = [
    "FROM_SENSOR",
    "LARGEST_READING",
    "TABLES",
    "Column",
    "Episode",
    "Limits",
    "Log",
    "MessageReader",
    "RawToSI",
    "Remark",
    "Source",
    "TruthKind",
    "TruthSource",
    "check_format",
    "check_outputs",
    "check_unit",
    "decoded",
    "earlier",
    "episodes_of",
    "file_of",
    "frozen",
    "header",
    "held_samples",
    "jumps_away",
    "name_and_unit",
    "open_table",
    "read_angles",
    "read_log",
    "read_table",
    "read_truth",
    "said_of_jumps",
    "says_nothing",
    "shown",
    "sources_of",
    "true_angles",
    "true_torques",
    "write_columns",
    "write_log",
    "write_together",
    "write_whole",
]
