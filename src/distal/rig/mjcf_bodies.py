"""Joints and links of a MuJoCo model, as a chain whose frames are all parallel where all angles are
zero, with their springs and the stiffness of their limits; the lengths and moment arms of its
tendons at poses, and the polynomial of lowest degree in the joints' angles that gives a length;
and values for what a model does not say.

A `length_unit` is the number of metres in a model's unit of length. Masses are in kilograms and
times in seconds, so that a unit of force is so many newtons and one of torque, length_unit², so
many newton metres.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb, hypot
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from distal.arrays import Floats
from distal.errors import RigError
from distal.rig.components import REACH
from distal.rig.files import Guess, name_of
from distal.rig.values_with_stds import Raw

if TYPE_CHECKING:
    import mujoco


def mujoco_module() -> ModuleType:
    """Return the module `mujoco`.

    Raises:
        RigError: it is not installed.
    """
    try:
        return importlib.import_module("mujoco")
    except ImportError:
        raise RigError(
            "models of MuJoCo need the package 'mujoco': pip install '.[mujoco]'"
        ) from None


EMBEDDED = "distal_rig"
"""Name of the text in a model that holds the rig that it was written from."""


class ASSUMED:
    """Values for what a model does not have, with wide stds.

    Attributes:
        drive_mass: it matters little, since a filter follows the measured position [kg].
        joint_friction: friction coefficient of a joint whose model has `frictionloss`; only its
            product with the radius and the preload counts.
        friction_radius: radius of the axle of such a joint [m]. Its friction does not grow with the
            tensions, so the radius is small and nearly all of the load is preload.
        return_time: with which a joint leaves a stop into which a correction of a filter has put it
            [s]; in MuJoCo it is twice that of `solref`.
        position_noise: std of a position [m].
        lasting: factor that turns the RMS of what a polynomial leaves of a length into noise. What
            is left stays the same for about 36 samples (0.36 s), while noise is new in each sample;
            the factor is the square root of their number.
    """

    drive_mass = Guess(0.02, "the drive's mass")
    path_friction = Guess({"value": 0.05, "std": 0.1}, "friction along the path")
    nominal_force = Guess({"value": "5 N", "std": "5 N"}, "usual force")
    pretension = Guess(
        {"value": "1 N", "std": "1 N"}, "tension at zero angle and zero displacement"
    )
    rate = Guess(100.0, "rate of the sensors")
    force_noise = Guess("0.2 N", "noise of a force")
    encoder_step = Guess("0.1 deg", "encoders, which are for learning and comparing only")
    joint_friction = 1e-3
    friction_radius = 1e-3
    return_time = 1e-3
    position_noise = 2e-5
    lasting = 6.0

    @classmethod
    def noise(cls, left: float) -> Guess:
        """Return the noise of a tendon's position, √(σ² + (6 e)²); e is what a polynomial has
        `left` of the tendon's length [m, RMS].
        """
        size = hypot(cls.position_noise, cls.lasting * left)
        return Guess(float(f"{size:.2g}"), "noise of a position")

    @staticmethod
    def stiffness(drives: int, joints: int) -> Guess:
        """Return the series stiffness of tendons, for the number of drives and of joints that turn
        by themselves.

        Any stiffness from a third of the value to infinite is likely. With more drives than joints,
        drives pull against each other and their forces say where the joints are; a wide std would
        let the stiffness explain these forces instead, so that it is narrower:
        docs/results/hands.md.
        """
        return Guess(
            {"value": "20 N/mm", "std": "60 %" if drives > joints else "100 %"}, "series stiffness"
        )


POSES = 3000
"""Number of random poses at which the lengths of tendons are computed [1]. Source: judgement."""

CROSSED = 1e-3
"""A tendon crosses a joint where its moment arm is larger than this share of its largest one [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Poses:
    """Lengths and moment arms of tendons at k poses, in the model's units.

    Args:
        angles: of the joints [rad], (k, n_joints).
        lengths: of the tendons, (k, n_tendons).
        arms: ∂length/∂angle, (k, n_tendons, n_joints).
        wraps: number of points of each tendon's path, (k, n_tendons); it changes where the tendon
            touches a surface or leaves it.
    """

    angles: Floats
    lengths: Floats
    arms: Floats
    wraps: NDArray[np.int64]


def only_number(values: Floats | float) -> float:
    """Return a number of a model, which newer versions of MuJoCo keep as the first one of a row."""
    return float(np.ravel(values)[0])


def range_of(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Return the range of a joint [rad], ± `REACH` where the model has none."""
    if not model.jnt_limited[joint]:
        return -REACH, REACH
    low, high = model.jnt_range[joint]
    return float(low), float(high)


def tendon_slopes(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return ∂length/∂q of all tendons from `data` in which their lengths are computed, (n_tendons,
    n_v).
    """
    import mujoco

    slopes = np.zeros((model.ntendon, model.nv))
    columns = np.ravel(model.ten_J_colind)
    mujoco.mju_sparse2dense(
        slopes, np.ravel(data.ten_J), model.ten_J_rownnz, model.ten_J_rowadr, columns
    )
    return slopes


def at_poses(model: mujoco.MjModel, joints: Sequence[int], angles: Floats) -> Poses:
    """Return lengths and moment arms of all tendons at `angles` of some joints [rad], (k,
    n_joints); other joints stay where the model has them.
    """
    import mujoco

    data = mujoco.MjData(model)
    positions = model.jnt_qposadr[list(joints)]
    speeds = model.jnt_dofadr[list(joints)]
    poses = []
    for row in angles:
        data.qpos[positions] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        arms = tendon_slopes(model, data)[:, speeds]
        poses.append((data.ten_length.copy(), arms, data.ten_wrapnum.copy()))
    return Poses(angles, *map(np.array, zip(*poses)))


def over_ranges(
    model: mujoco.MjModel, joints: Sequence[int], count: int = POSES, seed: int = 0
) -> Poses:
    """Return lengths and moment arms at a `count` of random poses within the joints' ranges."""
    ends = np.array([range_of(model, j) for j in joints])
    drawn = np.random.default_rng(seed).uniform(size=(count, len(joints)))
    return at_poses(model, joints, ends[:, 0] + drawn * (ends[:, 1] - ends[:, 0]))


def turned_by(poses: Poses, tendon: int) -> list[int]:
    """Return which of the joints of some poses a tendon turns, by their positions in `poses`."""
    size = np.abs(poses.arms[:, tendon]).max(axis=0)
    return [k for k, arm in enumerate(size) if arm > CROSSED * max(size.max(), 1e-12)]


LARGEST_ARM_ERROR = 0.01
"""A polynomial is accepted where its RMS error of each moment arm, over poses to which it was not
fitted, is at most this share of the largest arm [1]. Source: judgement.
"""

HIGHEST_DEGREE = 5
"""Highest degree of polynomials that are tried [1]. Source: judgement."""

MOST_TERMS = 252
"""Largest number of terms, with the constant, of polynomials that are tried [1]: those of degree 5
in five joints. Time and memory grow with its square. Source: definition.
"""

NEARLY = 1.25
"""Where no degree reaches `LARGEST_ARM_ERROR`, the lowest one and the fewest terms are taken whose
error is at most so many times the least one [1]. Source: judgement.
"""


@dataclass(frozen=True)
class Excursion:
    """How the length of a tendon changes with the angles of joints: Σ c Π θ_j^{n_j}.

    Args:
        powers: n_j of each term, (n_terms, n_joints).
        coefficients: c of each term, (n_terms,).
        length_rms: RMS error of the length, over poses to which the polynomial was not fitted.
        arm_rms: RMS error of each joint's moment arm over these poses, as a share of the largest
            arm, (n_joints,).
        arm_most: below this share are 92 % of the errors of the worst joint's moment arm on these
            poses, and about 90 % on further poses.
    """

    powers: NDArray[np.int64]
    coefficients: Floats
    length_rms: float
    arm_rms: Floats
    arm_most: float

    @property
    def degree(self) -> int:
        """The degree of the polynomial, its highest sum of powers."""
        return int(self.powers.sum(axis=1).max())


def fit_excursion(angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    """Return the polynomial of lowest degree that reaches `LARGEST_ARM_ERROR`; where none does, the
    lowest that is nearly the best.

    Lengths and moment arms are fitted together, each as a share of its size, by least squares. Then
    only the terms that the accuracy needs are kept: one by one, the term that explains most of what
    is left is taken (orthogonal matching pursuit: Pati, Rezaiifar, Krishnaprasad, Asilomar 1993).

    Args:
        angles: of the joints that the tendon crosses [rad], (k, n_joints).
        lengths: of the tendon, less the length with all of these joints at zero, (k,).
        arms: ∂length/∂angle, (k, n_joints).
    """
    fits = list[Excursion]()
    joints = angles.shape[1]
    for degree in range(1, HIGHEST_DEGREE + 1):
        if comb(joints + degree, degree) > MOST_TERMS:
            break
        fits.append(_fitted(_powers(joints, degree), angles, lengths, arms))
        if fits[-1].arm_rms.max() <= LARGEST_ARM_ERROR:
            break
    least = min(fit.arm_rms.max() for fit in fits)
    enough = LARGEST_ARM_ERROR if least <= LARGEST_ARM_ERROR else NEARLY * least
    full = next(fit for fit in fits if fit.arm_rms.max() <= enough)
    rows, desired = _equations(full.powers, angles, lengths, arms)
    directions = rows / np.linalg.norm(rows, axis=0)
    gram = directions.T @ directions
    explained = desired @ directions
    chosen = list[int]()
    left = explained
    while len(chosen) < len(full.powers):
        gains = np.abs(left)
        gains[chosen] = -1.0
        chosen.append(int(gains.argmax()))
        among = gram[np.ix_(chosen, chosen)]
        weights = np.linalg.lstsq(among, explained[chosen], rcond=None)[0]
        left = explained - gram[:, chosen] @ weights
        # with a joint that has no term the error is too large in any case
        if np.all(full.powers[chosen].any(axis=0)):
            shorter = _fitted(full.powers[sorted(chosen)], angles, lengths, arms)
            if shorter.arm_rms.max() <= enough:
                return shorter
    return full


def _powers(joints: int, degree: int) -> NDArray[np.int64]:
    products = [
        chosen
        for d in range(1, degree + 1)
        for chosen in combinations_with_replacement(range(joints), d)
    ]
    return np.array([np.bincount(chosen, minlength=joints) for chosen in products])


def _terms(angles: Floats, powers: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return values, (k, n_terms), and slopes of the terms, (n_joints, k, n_terms)."""

    def values(powers: NDArray[np.int64]) -> Floats:
        products: Floats = np.prod(angles[:, None] ** powers, axis=2)
        return products

    lower = np.eye(angles.shape[1], dtype=np.int64)
    slopes = [powers @ axis * values(np.maximum(powers - axis, 0)) for axis in lower]
    return values(powers), np.array(slopes)


def _equations(
    powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats
) -> tuple[Floats, Floats]:
    """Return rows and right sides of the least squares: lengths and moment arms of every second
    pose; the others judge the fit.
    """
    size = np.abs(arms).max(axis=0)
    span = max(np.ptp(lengths), 1e-12)
    values, slopes = _terms(angles[::2], powers)
    rows = np.vstack([values / span, *(slopes / size[:, None, None])])
    return rows, np.concatenate([lengths[::2] / span, *(arms[::2] / size).T])


def _fitted(powers: NDArray[np.int64], angles: Floats, lengths: Floats, arms: Floats) -> Excursion:
    rows, desired = _equations(powers, angles, lengths, arms)
    coefficients: Floats = np.linalg.lstsq(rows, desired, rcond=None)[0].astype(np.float64)
    values, slopes = _terms(angles[1::2], powers)
    left: Floats = np.abs((slopes @ coefficients).T - arms[1::2]) / np.abs(arms).max(axis=0)
    off = values @ coefficients - lengths[1::2]
    return Excursion(
        powers,
        coefficients,
        float(np.sqrt(np.mean(off**2))),
        np.sqrt(np.mean(left**2, axis=0)),
        float(np.quantile(left, 0.92, axis=0).max()),
    )


SMALLEST_INERTIA = 1e-9
"""Inertia of a joint to which the model gives no armature, beside its link's [kg m²]. Source:
rounding (an inertia of zero).
"""


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return the name of a joint in the rig."""
    return name_of(model.joint(joint).name, f"joint{joint}")


def tendon_name(model: mujoco.MjModel, tendon: int) -> str:
    """Return the name of a tendon in the rig."""
    return name_of(model.tendon(tendon).name, f"tendon{tendon}")


def kept_at(model: mujoco.MjModel, dof: int, joints: Sequence[int]) -> int:
    """Return the last of the kept `joints` on the way from the base to a degree of freedom, which
    may be its own, −1 where there is none.
    """
    while dof >= 0 and model.dof_jntid[dof] not in joints:
        dof = model.dof_parentid[dof]
    return int(model.dof_jntid[dof]) if dof >= 0 else -1


def described_joints(
    model: mujoco.MjModel,
    joints: Sequence[int],
    length_unit: float,
    springs: Mapping[int, Mapping[str, float]],
    coupled: Sequence[Coupled],
) -> tuple[Raw, list[Raw]]:
    """Return the raw base and the raw joints, in the model's order, with axes, positions, links,
    armature, damping, friction, springs, couplings and stops; a joint leads those that follow it
    within the stops of all.

    Args:
        length_unit: metres in one unit of length of the model.
        springs: index of a joint → its raw return spring.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[list(joints)]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frame = data.xmat[model.jnt_bodyid[joints[0]]].reshape(3, 3)
    # for each body which of the kept joints turns it, −1 where none does
    last = [model.body_dofadr[body] + model.body_dofnum[body] - 1 for body in model.body_weldid]
    carrier = [kept_at(model, dof, joints) for dof in last]
    leads = {pair.follower: pair for pair in coupled}
    described = list[Raw]()
    for j in joints:
        dof = model.jnt_dofadr[j]
        parent = kept_at(model, model.dof_parentid[dof], joints)
        position = data.xanchor[j] - data.xanchor[parent if parent >= 0 else joints[0]]
        raw: Raw = {
            "name": joint_name(model, j),
            "parent": joint_name(model, parent) if parent >= 0 else "base",
            "offset": _rounded(frame.T @ position * length_unit),
            "axis": _rounded(frame.T @ data.xaxis[j], 12),
        }
        bodies = [body for body in range(model.nbody) if carrier[body] == j]
        raw |= _link(model, data, bodies, data.xanchor[j], frame, length_unit)
        raw["inertia"] = max(float(model.dof_armature[dof]) * length_unit**2, SMALLEST_INERTIA)
        raw["damping"] = only_number(model.dof_damping[dof]) * length_unit**2
        loss = float(model.dof_frictionloss[dof]) * length_unit**2
        if loss > 0.0:
            coefficient = {"value": ASSUMED.joint_friction, "std": "30 %"}
            raw["friction"] = {
                "coefficient": Guess(coefficient, "how well friction is known"),
                "radius": ASSUMED.friction_radius,
                "preload": loss / (ASSUMED.joint_friction * ASSUMED.friction_radius),
            }
        if j in springs:
            raw["spring"] = dict(springs[j])
        if j in leads:
            name = joint_name(model, leads[j].leader)
            raw["coupled"] = {"joint": name, "ratio": leads[j].ratio, "offset": leads[j].offset}
        else:
            initial = float(model.qpos0[model.jnt_qposadr[j]])
            raw["initial"] = Guess({"value": initial, "std": "5 deg"}, "angle at the start")
            raw |= described_stop(model, j, length_unit, coupled)
        described.append(raw)
    gravity = (model.opt.gravity * length_unit).tolist()
    return {"gravity": gravity, "orientation": _rounded(_roll_pitch_yaw(frame), 12)}, described


def _link(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: list[int],
    origin: Floats,
    frame: Floats,
    length_unit: float,
) -> Raw:
    """Return the raw link of bodies that move together, in the joint's frame: mass, centre and
    moments of inertia; empty if they are massless.
    """
    # about the centre of mass of all: moments and products of inertia, mass times offset, mass
    spatial_inertia = data.cinert[bodies].sum(axis=0)
    mass = float(spatial_inertia[9])
    if mass <= 0.0:
        return {}
    off = spatial_inertia[6:9] / mass
    shift = mass * (off @ off * np.eye(3) - np.outer(off, off))
    turned = frame.T @ (spatial_inertia[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]] - shift) @ frame
    centre = data.subtree_com[model.body_rootid[bodies[0]]] + off - origin
    link = {
        "mass": mass,
        "centre": _rounded(centre @ frame * length_unit),
        "inertia": [float(f"{moment:.6g}") for moment in np.diag(turned) * length_unit**2],
    }
    return {"link": link}


def _rounded(values: Floats, digits: int = 9) -> list[float]:
    return [round(float(value), digits) + 0.0 for value in values]


def _roll_pitch_yaw(matrix: Floats) -> Floats:
    """Return the angles of R = R_z(yaw) R_y(pitch) R_x(roll)."""
    with warnings.catch_warnings():
        # where pitch is ±90°, only a sum of the other two is determined; scipy warns and takes one
        warnings.simplefilter("ignore", UserWarning)
        angles: Floats = Rotation.from_matrix(matrix).as_euler("xyz")
    return angles


def stiffness_at_rest(
    model: mujoco.MjModel, solref: Floats, solimp: Floats, inverse_inertia: float
) -> float:
    """Return the stiffness of a constraint at rest, beyond the width of `solimp`, in the model's
    units.

    It is K = k/((1 − d) A), with k = 1/(T ζ)² or −solref[0], d = d_max and A the `inverse_inertia`.
    This follows from MuJoCo's documentation, "Computation": the force is f = (a_ref − a)/R with R =
    A (1 − d)/d and a_ref = −(d/d_max²) k r at rest.
    """
    time = float(solref[0])
    ratio = float(solref[1])
    d = float(np.clip(solimp[1], 1e-4, 0.9999))
    # MuJoCo takes no time constant below two steps
    k = 1.0 / (max(time, 2.0 * float(model.opt.timestep)) * ratio) ** 2 if time > 0.0 else -time
    return k / ((1.0 - d) * max(inverse_inertia, 1e-12))


def described_stop(
    model: mujoco.MjModel, joint: int, length_unit: float, coupled: Sequence[Coupled]
) -> Raw:
    """Return the stops of a joint, raw, within which it and all joints that follow it are within
    their limits, with stiffness and damping by the joint's limits in MuJoCo; empty where none of
    them has limits. The model's unit of length has `length_unit` metres.
    """
    ends = [list(range_of(model, joint))] if model.jnt_limited[joint] else []
    for pair in coupled:
        if pair.leader == joint and model.jnt_limited[pair.follower]:
            limits = range_of(model, pair.follower)
            ends.append(sorted((end - pair.offset) / pair.ratio for end in limits))
    if not ends:
        return {}
    lows, highs = zip(*ends)
    inverse = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    stiffness = (
        stiffness_at_rest(model, model.jnt_solref[joint], model.jnt_solimp[joint], inverse)
        * length_unit**2
    )
    return {
        "stops": [max(lows), min(highs)],
        "stop_stiffness": float(f"{stiffness:.6g}"),
        "stop_damping": float(f"{ASSUMED.return_time * stiffness:.6g}"),
    }


@dataclass(frozen=True)
class Coupled:
    """A coupling θ_follower = ratio θ_leader + offset [rad]; the leader has the lower index.

    The `stiffness` holds the follower there, in the model's units.
    """

    leader: int
    follower: int
    ratio: float
    offset: float
    stiffness: float


FARTHEST_REST = 100.0
"""Largest distance from the middle of a joint's range at which its spring is relaxed, in ranges
[1]. Source: rounding (roots of a nearly constant torque).
"""


def spring_tendons(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the tendons that are springs."""
    return [t for t in range(model.ntendon) if only_number(model.tendon_stiffness[t]) > 0.0]


def joint_springs(
    model: mujoco.MjModel, joints: Sequence[int], length_unit: float
) -> tuple[dict[int, dict[str, float]], list[str]]:
    """Return the raw return spring of each joint that has one, and what is left out, in words.

    The torques of all springs that act on one joint alone are added over its range, and −(k x + q
    x² + c x³) with x = θ − θ₀ is fitted to the sum. The model's unit of length has `length_unit`
    metres.
    """
    springs = dict[int, dict[str, float]]()
    left = list[str]()
    poses = over_ranges(model, joints)
    crossing = {t: [joints[k] for k in turned_by(poses, t)] for t in spring_tendons(model)}
    for t, crossed in crossing.items():
        if len(crossed) > 1:
            names = ", ".join(joint_name(model, j) for j in crossed)
            left.append(
                f"spring '{tendon_name(model, t)}' pulls at several joints ({names}): left out"
            )
    for j in joints:
        angles = np.linspace(*range_of(model, j), POSES)
        relaxed = float(model.qpos_spring[model.jnt_qposadr[j]])
        torque = -only_number(model.jnt_stiffness[j]) * (angles - relaxed)
        for t, crossed in crossing.items():
            if crossed != [j]:
                continue
            along = at_poses(model, [j], angles[:, None])
            low_length, high_length = np.ravel(model.tendon_lengthspring[t])[:2]
            length = along.lengths[:, t]
            stiffness = only_number(model.tendon_stiffness[t])
            stretched = length - np.clip(length, low_length, high_length)
            torque = torque - stiffness * stretched * along.arms[:, t, 0]
        if np.abs(torque).max() > 0.0:
            torque *= length_unit**2
            springs[j], rms = _as_spring(angles, torque)
            if rms > 0.05 * np.abs(torque).max():
                left.append(
                    f"springs of joint '{joint_name(model, j)}': a cubic leaves {rms:.2g} N m (RMS)"
                )
    return springs, left


def _as_spring(angles: Floats, torque: Floats) -> tuple[dict[str, float], float]:
    """Return the spring whose torque over the range is nearest, and the RMS of what it leaves;
    where it is relaxed, its stiffness is not negative.
    """
    span = float(angles[-1] - angles[0])
    middle = (angles[0] + angles[-1]) / 2
    # where the torque does not fall over the range: a weak spring that is relaxed far away
    mean = float(np.mean(torque))
    zero = float(middle + np.copysign(FARTHEST_REST * span, mean))
    weak = abs(mean) / (FARTHEST_REST * span)
    fitted = Polynomial([weak * zero, -weak])
    for degree in (1, 3):
        nearer = Polynomial.fit(angles, torque, degree).convert()
        slope = nearer.deriv()
        # further away it is rounding that bends the curve
        roots = [
            float(root.real)
            for root in nearer.roots()
            if abs(root.imag) < 1e-9
            and -slope(root.real) > 0.0
            and abs(root.real - middle) <= FARTHEST_REST * span
        ]
        if roots:
            fitted = nearer
            zero = min(roots, key=lambda root: abs(root - middle))
    # about the angle where it is relaxed
    _, *factors = (-fitted(Polynomial([zero, 1.0])).coef).tolist()
    spring = {"stiffness": factors[0], "rest_angle": zero} | dict(
        zip(("quadratic", "cubic"), factors[1:])
    )
    rms = float(np.sqrt(np.mean((fitted(angles) - torque) ** 2)))
    return {name: float(f"{size:.6g}") for name, size in spring.items() if size}, rms
