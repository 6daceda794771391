"""The description of a rig: joints, drives, tendons and sensors, read from TOML and checked."""

from distal.rig.drives import (
    Capstan,
    Hysteresis,
    Slider,
    SliderHysteresis,
    effort_unit,
    position_unit,
)
from distal.rig.files import (
    Guess,
    Imported,
    as_rig,
    build_rig,
    edited_text,
    load_rig,
    name_of,
    parse_toml,
    read_text,
    rig_text,
    shipped_rigs,
)
from distal.rig.hand_tables.aero import from_aero
from distal.rig.hand_tables.described import from_table
from distal.rig.hand_tables.orca import from_orca, orca_order
from distal.rig.insertions import Linkage, Pinned, Polynomial, Pulley, Size
from distal.rig.joints import Joint
from distal.rig.learned import (
    HALF_WIDTHS,
    IN_RADIAL,
    NOTHING_NORMAL,
    TIME_CONSTANTS,
    FreeMotion,
    LearnedMap,
    LearnedMaps,
    MapArrays,
    arrays_file,
    as_table,
)
from distal.rig.mjcf.excursion import compare_lengths
from distal.rig.mjcf.importer import from_mujoco
from distal.rig.overrides import ALL, parse_assignment, set_value
from distal.rig.plausibility import (
    Number,
    check_scales,
    doubts,
    known_to_a_factor,
    number,
    scales_in_words,
)
from distal.rig.quantities import Description, In, Parameter
from distal.rig.rig import Rig, parameters_below
from distal.rig.sensors.base import COUNTS, Motion, Role
from distal.rig.sensors.motions import drive_travel
from distal.rig.sensors.registry import (
    REFERENCES,
    Sensor,
    gain_of,
    log_factor,
    log_unit,
    measurand_of,
    part_of,
    step_of,
    travel_of,
)
from distal.rig.subsystems import Subsystem, independent_parts
from distal.rig.tendons import Meeting, Tendon
from distal.rig.touch import contact_shape, felt_in_words
from distal.rig.validation import (
    angle_names,
    in_words,
    named,
    part_at,
    speed_names,
    std_name,
    tendon_angle_name,
    torque_names,
    validated,
)

__all__ = [
    "ALL",
    "COUNTS",
    "HALF_WIDTHS",
    "IN_RADIAL",
    "NOTHING_NORMAL",
    "REFERENCES",
    "TIME_CONSTANTS",
    "Capstan",
    "Description",
    "FreeMotion",
    "Guess",
    "Hysteresis",
    "Imported",
    "In",
    "Joint",
    "LearnedMap",
    "LearnedMaps",
    "Linkage",
    "MapArrays",
    "Meeting",
    "Motion",
    "Number",
    "Parameter",
    "Pinned",
    "Polynomial",
    "Pulley",
    "Rig",
    "Role",
    "Sensor",
    "Size",
    "Slider",
    "SliderHysteresis",
    "Subsystem",
    "Tendon",
    "angle_names",
    "arrays_file",
    "as_rig",
    "as_table",
    "build_rig",
    "check_scales",
    "compare_lengths",
    "contact_shape",
    "doubts",
    "drive_travel",
    "edited_text",
    "effort_unit",
    "felt_in_words",
    "from_aero",
    "from_mujoco",
    "from_orca",
    "from_table",
    "gain_of",
    "in_words",
    "independent_parts",
    "known_to_a_factor",
    "load_rig",
    "log_factor",
    "log_unit",
    "measurand_of",
    "name_of",
    "named",
    "number",
    "orca_order",
    "parameters_below",
    "parse_assignment",
    "parse_toml",
    "part_at",
    "part_of",
    "position_unit",
    "read_text",
    "rig_text",
    "scales_in_words",
    "set_value",
    "shipped_rigs",
    "speed_names",
    "std_name",
    "step_of",
    "tendon_angle_name",
    "torque_names",
    "travel_of",
    "validated",
]
