"""The description of a rig: joints, drives, tendons and sensors, read from TOML and checked."""

from distal.rig.affine import Affine, AffineJoint
from distal.rig.chain import BASE, Base, Coupling, Link
from distal.rig.columns import angle_names, speed_names, std_name, tendon_angle_name, torque_names
from distal.rig.contact import Contact
from distal.rig.discrepancy import CONSTANT, Discrepancy, factors
from distal.rig.drives import (
    Capstan,
    CapstanFriction,
    Hysteresis,
    Slider,
    SliderFriction,
    SliderHysteresis,
    SliderStribeck,
    effort_unit,
    position_unit,
)
from distal.rig.files import (
    build_rig,
    edited_text,
    load_rig,
    parse_toml,
    read_text,
    rig_text,
    shipped_rigs,
    template_text,
)
from distal.rig.joints import ExternalTorque, Gravity, Joint, JointFriction, Spring, Stribeck
from distal.rig.numbers import Number, number
from distal.rig.overrides import parse_assignment, set_value
from distal.rig.plausibility import doubts
from distal.rig.quantities import Description, In, Parameter
from distal.rig.rig import LogFormat, Rig, Stepping
from distal.rig.sensors import REFERENCES, Sensor, SensorBase, gain_of, log_factor
from distal.rig.tendons import (
    Creep,
    CrossedLinkage,
    CrossedPinned,
    CrossedPulley,
    Guide,
    Linkage,
    Meeting,
    Path,
    Pinned,
    Polynomial,
    Pulley,
    Tendon,
)
from distal.rig.validation import validated

__all__ = [
    "BASE",
    "CONSTANT",
    "REFERENCES",
    "Affine",
    "AffineJoint",
    "Base",
    "Capstan",
    "CapstanFriction",
    "Contact",
    "Coupling",
    "Creep",
    "CrossedLinkage",
    "CrossedPinned",
    "CrossedPulley",
    "Description",
    "Discrepancy",
    "ExternalTorque",
    "Gravity",
    "Guide",
    "Hysteresis",
    "In",
    "Joint",
    "JointFriction",
    "Link",
    "Linkage",
    "LogFormat",
    "Meeting",
    "Number",
    "Parameter",
    "Path",
    "Pinned",
    "Polynomial",
    "Pulley",
    "Rig",
    "Sensor",
    "SensorBase",
    "Slider",
    "SliderFriction",
    "SliderHysteresis",
    "SliderStribeck",
    "Spring",
    "Stepping",
    "Stribeck",
    "Tendon",
    "angle_names",
    "build_rig",
    "doubts",
    "edited_text",
    "effort_unit",
    "factors",
    "gain_of",
    "load_rig",
    "log_factor",
    "number",
    "parse_assignment",
    "parse_toml",
    "position_unit",
    "read_text",
    "rig_text",
    "set_value",
    "shipped_rigs",
    "speed_names",
    "std_name",
    "template_text",
    "tendon_angle_name",
    "torque_names",
    "validated",
]
