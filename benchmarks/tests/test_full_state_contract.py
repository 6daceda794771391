"""The filters of the 2008 paper, which are not in the package, do what every estimator must: the
package's own tests, with their names.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.estimators import test_contract as contract
from tests.estimators.test_contract import log, rig  # noqa: F401
from tests.estimators.test_covariances import test_a_reported_covariance_is_one as is_covariance
from tests.estimators.test_first_sample import test_offsets_and_gains_are_taken_off as takes_off
from tests.export import test_export as exports
from tests.export.helpers import spoiled
from tests.kernels.test_kernels import test_estimators_compiled_and_interpreted_agree as agrees
from tests.run import test_batch as batches

import benchmarks.paper_2008  # noqa: F401 - the estimators ekf and ekf-2008
from distal import Log, Rig, load_scenario, shipped_rigs, simulate

NAMES = ("ekf-2008", "ekf")
CHECKS = [
    *(
        check
        for called, check in vars(contract).items()
        if called.startswith("test_") and "name" in inspect.signature(check).parameters
    ),
    takes_off,
    agrees,
]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("check", CHECKS)
def test_the_contract(check: Callable[..., None], name: str, rig: Rig, log: Log) -> None:  # noqa: F811
    given = {"name": name, "rig": rig, "log": log, "which": "pulley-antagonist"}
    check(**{each: given[each] for each in inspect.signature(check).parameters})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("which", [name for name in shipped_rigs() if name != "hand"])
def test_its_covariances_are_some(which: str, name: str) -> None:
    is_covariance(which, name)


@pytest.mark.parametrize("name", NAMES)
def test_its_c_gives_the_numbers_of_python(name: str, rig: Rig, tmp_path: Path) -> None:  # noqa: F811
    plain = simulate(rig, load_scenario("series-2"), 5)
    bad = spoiled(plain)
    exports.test_a_whole_log_under_sanitizers(rig, bad, plain, name, False, tmp_path)
    exports.test_beliefs_and_innovations_are_pythons(rig, bad, name, tmp_path)


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_gives_the_same_numbers(name: str, rig: Rig) -> None:  # noqa: F811
    batches.test_the_numbers_are_those_of_one_by_one(rig, batches.made_logs(rig), name)
