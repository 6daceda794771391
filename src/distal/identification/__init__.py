"""A rig's parameters and noise from its own logs, and what the logs can tell."""

from distal.identification.affine import AffineFit, LeftOut, affine_table, learn_affine
from distal.identification.contact import ContactFit, learn_contact
from distal.identification.crossvalidation import CrossValidation, HeldOut, cross_validate
from distal.identification.discrepancy import DiscrepancyFit, learn_discrepancy
from distal.identification.fit import fit
from distal.identification.fitted import Fitted
from distal.identification.free import Free
from distal.identification.groups import groups_of
from distal.identification.leaving_out import Compared, Score
from distal.identification.observability import Observability, observability
from distal.identification.result import Fit

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
