"""The description of a rig: joints, drives, tendons and sensors, read from TOML and checked."""

from distal.rig.columns import angle_names, speed_names, std_name, tendon_angle_name, torque_names
from distal.rig.contact_shape import contact_shape
from distal.rig.drives import (
    Capstan,
    Hysteresis,
    Slider,
    SliderHysteresis,
    effort_unit,
    position_unit,
)
from distal.rig.felt import felt_in_words
from distal.rig.files import (
    as_rig,
    build_rig,
    edited_text,
    load_rig,
    parse_toml,
    read_text,
    rig_text,
    shipped_rigs,
    template_text,
)
from distal.rig.free_motion import NOTHING_NORMAL, FreeMotion
from distal.rig.hand_tables import from_aero, from_orca, from_table, orca_order
from distal.rig.imported import Guess, Imported, name_of
from distal.rig.insertions import Linkage, Pinned, Polynomial, Pulley, Size
from distal.rig.joints import Joint
from distal.rig.learned_map import (
    HALF_WIDTHS,
    IN_RADIAL,
    TIME_CONSTANTS,
    LearnedMap,
    LearnedMaps,
    MapArrays,
    arrays_file,
    as_table,
    features_of,
    with_arrays,
)
from distal.rig.mjcf import compare_lengths, from_mujoco
from distal.rig.naming import in_words, named, part_at
from distal.rig.overrides import ALL, parse_assignment, set_value
from distal.rig.parameter_references import Number, known_to_a_factor, number
from distal.rig.plausibility import doubts
from distal.rig.quantities import Description, In, Parameter
from distal.rig.rig import Rig, parameters_below
from distal.rig.sensors import (
    COUNTS,
    REFERENCES,
    Role,
    Sensor,
    drive_travel,
    gain_of,
    log_factor,
    log_unit,
    measurand_of,
    part_of,
    step_of,
    travel_of,
)
from distal.rig.subsystems import Subsystem, independent_parts
from distal.rig.taken_scales import check_scales, scales_in_words
from distal.rig.tendons import Creep, Meeting, Tendon
from distal.rig.validation import validated

__all__ = [
    "ALL",
    "COUNTS",
    "HALF_WIDTHS",
    "IN_RADIAL",
    "NOTHING_NORMAL",
    "REFERENCES",
    "TIME_CONSTANTS",
    "Capstan",
    "Creep",
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
    "features_of",
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
    "template_text",
    "tendon_angle_name",
    "torque_names",
    "travel_of",
    "validated",
    "with_arrays",
]
