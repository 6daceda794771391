"""The driver: runs alone or in lanes give the same numbers, in order, and samples get their own
rows.
"""

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import distal
from distal.kernels import Advanced, Feed, Kernel, advance, advance_all, at_samples

pytestmark = pytest.mark.usefixtures("as_users_compile")


def kernel(compiled: bool) -> Kernel:
    kernel_state, x, p = ca.SX.sym("kernel_state", 2), ca.SX.sym("x"), ca.SX.sym("p")
    following = ca.vertcat(kernel_state[1] + p, ca.sin(kernel_state[0]) + x)
    outputs = [following, ca.vertcat(kernel_state[0] * x, p)]
    return Kernel(ca.Function("driver", [kernel_state, x, p], outputs), compiled)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("keep", [None, (), (1,)])
def test_more_runs_than_lanes_are_those_of_one_by_one(
    compiled: bool, keep: tuple[int, ...] | None
) -> None:
    rng = np.random.default_rng(3)
    feeds = [
        Feed(rng.normal(size=2), rng.normal(size=(5 + k, 1)), rng.normal(size=1)) for k in range(19)
    ]
    driven = kernel(compiled)
    runs = advance_all(driven, feeds, keep)
    kept = [0, 1] if keep is None else list(keep)
    for feed, run in zip(feeds, runs, strict=True):
        one, other = feed.kernel_state
        for x, state, y in zip(feed.rows[:, 0], run.kernel_states, run.ys, strict=True):
            np.testing.assert_allclose(y, [one * x, feed.p[0]], rtol=1e-14)
            one, other = other + feed.p[0], np.sin(one) + x
            np.testing.assert_allclose(state, np.array([one, other])[kept], rtol=1e-12)
        np.testing.assert_array_equal(run.ys, advance(driven, feed).ys)


def test_no_run_is_none_and_a_kernel_without_a_compiler_has_one_lane() -> None:
    assert advance_all(kernel(False), []) == []
    assert kernel(False).side_by_side == 1


def test_bridges_of_gaps_are_left_out() -> None:
    run = Advanced(np.arange(8.0).reshape(4, 2), np.arange(4.0).reshape(4, 1))
    kernel_states, ys = at_samples(run, np.array([0, 3]))
    np.testing.assert_array_equal(kernel_states, [[0, 1], [6, 7]])
    np.testing.assert_array_equal(ys, [[0], [3]])
    assert at_samples(run, np.arange(4)) is run


def test_kernels_are_fed_by_the_driver_alone() -> None:
    """Live estimators, inverses and tendons in MuJoCo step loops of their own, many estimators
    lanes, or scan sample by sample; all others call `advance` or `advance_all`.
    """
    source = Path(distal.__file__).parent
    fed = re.compile(r"(kernel|lanes|loop)(\(.*\))?\.(step|scan|lanes|loop)\(")
    files = (
        path.relative_to(source).as_posix()
        for path in source.rglob("*.py")
        if fed.search(path.read_text("utf-8"))
    )
    assert sorted(path for path in files if not path.startswith("kernels/")) == [
        "bridges/mujoco.py",
        "bridges/torch.py",
        "inverse/live_inverse.py",
        "run/live_estimator.py",
    ]
