"""A rig's parameters and noise from its own logs, and what the logs can tell."""

from distal.fitting.affine import AffineFit, LeftOut, affine_table, learn_affine
from distal.fitting.contact import ContactFit, learn_contact
from distal.fitting.crossvalidation import CrossValidation, HeldOut, cross_validate
from distal.fitting.discrepancy import DiscrepancyFit, learn_discrepancy
from distal.fitting.fit import fit
from distal.fitting.fitted import Fitted
from distal.fitting.free import Free
from distal.fitting.groups import groups_of
from distal.fitting.leaving_out import Compared, Score
from distal.fitting.observability import Observability, observability
from distal.fitting.result import Fit

__all__ = [
    "AffineFit",
    "Compared",
    "ContactFit",
    "CrossValidation",
    "DiscrepancyFit",
    "Fit",
    "Fitted",
    "Free",
    "HeldOut",
    "LeftOut",
    "Observability",
    "Score",
    "affine_table",
    "cross_validate",
    "fit",
    "groups_of",
    "learn_affine",
    "learn_contact",
    "learn_discrepancy",
    "observability",
]
