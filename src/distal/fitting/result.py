"""The fitted rig as a file: values in their old positions, comments kept, and at the head an
account of the fit.

The result of a fit: values with standard errors, the origin of each, and the fitted rig.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from distal.confidence import COVERED_TEXT
from distal.errors import DistalError, DistalWarning, OutputError, RigError
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    REGRESSION,
    WRITTEN,
    Candidate,
    Compared,
    Judged,
    answer_maps,
    comparisons,
)
from distal.fitting.free_parameters import FittedParameter, assignments, paths_of
from distal.fitting.learned_maps import MapFit, reference_offset, reference_std
from distal.fitting.parameter_estimates import ParameterEstimates, among_models
from distal.logs import shown, write_together
from distal.regression import YARDSTICKS
from distal.rig import Rig, arrays_file, as_table, build_rig, parse_toml, set_value
from distal.units import rounded

MARK = "# Fitted by `distal "
"""The first words of a fitted file; by them the head of an earlier fit is found and replaced."""


LEARNED = ("map", "left_out")
"""Tables that a fit writes; one that this fit did not learn is removed, since it belongs
to an earlier fit.
"""


def fitted_text(
    rig: Rig,
    start: Rig,
    values: Mapping[str, object],
    head: str,
    text: str | None,
    table: Mapping[str, object] | None = None,
) -> str:
    """Return the TOML of a fitted rig, which reads as exactly this rig.

    If values in the old text would not read as this rig, the file is written anew, with a warning
    and without comments, so that no result is lost.

    Args:
        rig: the fitted rig.
        start: the original rig.
        values: path → value of what changed.
        head: comment at the head of the file, which begins with `MARK`.
        text: TOML of the original rig, whose comments stay; None writes the file anew.
        table: the table `[map]`, whose numbers are in the file that it names.

    Raises:
        RigError: the text is not that of the original rig.
        OutputError: the rig cannot be written so that it reads as the same.
    """
    rig = rig.model_copy(update={"map": None})
    if text is None:
        return head + _anew(rig, table)
    if _read(text).bare() != start.bare():
        raise RigError("the text is not that of the rig that was fitted; save without it")
    try:
        written = head + _put_into(text, rig, {**values, **({"map": table} if table else {})})
        agrees = _read(written) == rig
    except RigError:
        agrees = False
    if agrees:
        return written
    warnings.warn(
        "the fitted values do not fit into the text of the rig file: the file is written anew, "
        "without its comments",
        DistalWarning,
        stacklevel=2,
    )
    return head + _anew(rig, table)


def write_fitted(
    path: str | Path,
    rig: Rig,
    start: Rig,
    values: Mapping[str, object],
    head: str,
    text: str | None,
) -> None:
    """Write a fitted rig file, and beside it the numbers of its maps: both or none; see
    `fitted_text` for the arguments.

    Raises:
        OutputError: a file cannot be written; what stood there is unchanged.
    """
    files: dict[Path, bytes | str] = {}
    table = None
    if rig.map is not None:
        table, content = as_table(rig.map, path)
        files[arrays_file(path)] = content
    files[Path(path)] = fitted_text(rig, start, values, head, text, table)
    write_together(files)


def _put_into(text: str, rig: Rig, values: Mapping[str, object]) -> str:
    import tomlkit

    before = _without_old_head(text)
    document = tomlkit.parse(before)
    for learned in LEARNED:
        if learned in document and (learned == "map" or not getattr(rig, learned)):
            del document[learned]
    for path, value in values.items():
        set_value(document, path, value, RigError)
    return _without_guesses(tomlkit.dumps(document), before)


GUESSED = re.compile(r" # (not in the \w+: .*)$")
"""Comment of a draft beside a value that is a guess (`distal.rig.Guess`)."""


def _without_guesses(text: str, before: str) -> str:
    """Return a text in which no line that was changed calls its values guesses: that of one value
    loses its comment, one of several says that a part of them are.
    """
    old = set(before.split("\n"))
    lines = []
    for line in text.split("\n"):
        if line not in old:
            line = GUESSED.sub(r" # partly \1" if line.count("{") > 1 else "", line)
        lines.append(line)
    return "\n".join(lines)


def _anew(rig: Rig, table: Mapping[str, object] | None) -> str:
    """Return the TOML of a rig without maps, written anew, with the table `[map]`.

    Raises:
        OutputError: it does not read as this rig.
    """
    import tomlkit

    described = plain_value(rig.model_dump(exclude_defaults=True))
    written = tomlkit.dumps({**described, **({"map": plain_value(table)} if table else {})})
    if _read(written) != rig:
        raise OutputError(
            f"{rig.name}: the fitted rig cannot be written so that it reads as the same"
        )
    return written


def _read(text: str) -> Rig:
    """Return the rig of a text, without its maps, whose numbers are elsewhere."""
    raw = parse_toml(text, "fitted rig", RigError)
    return build_rig({key: value for key, value in raw.items() if key != "map"}, "fitted rig")


def plain_value(raw: Mapping[str, object]) -> dict[str, object]:
    """Return a description as TOML can hold it: without empty values, and without the SI tags that
    reading finds again.
    """
    return {key: _plain(value) for key, value in raw.items() if value is not None and key != "si"}


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return plain_value(value)
    return [_plain(part) for part in value] if isinstance(value, (list, tuple)) else value


def _without_old_head(text: str) -> str:
    """Return the text without the head of an earlier fit."""
    lines = text.split("\n")
    if not lines or not lines[0].startswith(MARK):
        return text
    first = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    return "\n".join(lines[first:]).lstrip("\n")


WORSE = 1.05
"""Ratio of the error of what is written to that of a way without a model of the rig, above which
the answer says so first [1]. Source: definition (of what a fit promises).
"""

HIDDEN = 0.5
"""Ratio of the std of an encoder's zero to the error that is scored beside it, above which the
advice names that zero. Source: judgement.
"""


@dataclass(frozen=True)
class Fit:
    """The result of `fit`.

    Args:
        rig: the description with all that was learned.
        start: the original description.
        part: name of the term that the original rig lacked; empty where none was added.
        parameters: the estimates of the rig's parameters.
        kept: whether `rig` has these estimates; else it has the original values.
        logs: names of the logs.
        duration: total duration of the logs [s].
        samples: total number of samples.
        homing: for how long the reference was read [s]; None: see `fit`.
        interrupted: whether the user interrupted the fit.
        maps: the learned maps by their kinds, see `LearnedMaps`.
        compared: each log of known angle, with the scores on it of all that the other logs teach.
        doubts: sentences with the reasons not to trust the fit.
        hold: whether filters are to take the parameters as exactly known.
        added: path → what was added to the description: the term it lacked, and the servos'
            stiffness and dead band.
        candidates: the candidates that were judged, the chosen one first.
        reference_std: std of the reference sensor's random error, which scores contain [rad].
        reference_offset: std of the reference sensor's zero, which no score shows [rad].
        text: TOML of the original rig into which `save` writes by default; empty where there is
            none.
        open_loop: RMS error of the angles in an open loop, on logs left out [rad]; NaN where the
            rig is for an estimator, or there are none.
    """

    rig: Rig
    start: Rig
    part: str
    parameters: ParameterEstimates
    kept: bool
    logs: tuple[str, ...]
    duration: float
    samples: int
    homing: float | None
    interrupted: bool
    maps: Mapping[str, MapFit] = field(default_factory=dict)
    compared: tuple[Compared, ...] = ()
    doubts: tuple[str, ...] = ()
    hold: bool = False
    added: Mapping[str, object] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    reference_std: float = 0.0
    reference_offset: float = 0.0
    text: str = ""
    open_loop: float = float("nan")

    @classmethod
    def of(cls, judged: Judged, chosen: Candidate) -> Fit:
        """Return the result of a fit if a candidate is chosen: its parameters, and its maps with
        those that are learned beside it from the same logs.
        """
        training = judged.training
        alone = judged.solutions[-1] if chosen.parameters is None else chosen.parameters
        parameters = among_models(alone, judged.models)
        maps = () if judged.line is None else answer_maps(chosen, training, judged.line)
        by_kind = {map_fit.kind: map_fit for map_fit in maps}
        ranked = sorted(judged.candidates, key=lambda way: (way is not chosen, way.error))
        added = {} if chosen.part is None else chosen.part.values
        logs = judged.logs
        return cls(
            rig=chosen.rig.bare().with_map(**{kind: of.maps for kind, of in by_kind.items()}),
            start=training.rig,
            part="" if chosen.part is None else chosen.part.name,
            parameters=parameters,
            kept=chosen.parameters is not None,
            logs=tuple(log.source for log in logs),
            duration=float(sum(log.time[-1] - log.time[0] for log in logs)),
            samples=sum(len(log) for log in logs),
            homing=training.options.homing,
            interrupted=judged.interrupted,
            maps=by_kind,
            compared=comparisons(training, ranked, by_kind) if ranked else (),
            doubts=(
                *parameters.doubts,
                *_unknown(training.unknown),
                *chosen.refused,
                *_as_given(chosen, ranked),
            ),
            hold=chosen.hold,
            added=added,
            candidates=tuple(replace(candidate, data={}) for candidate in ranked),
            reference_std=max((reference_std(training.rig, log) for log in logs), default=0.0),
            reference_offset=max(
                (reference_offset(training.rig, log) for log in logs), default=0.0
            ),
        )

    @property
    def model(self) -> Rig:
        """The original description with the servos and the term that the fit added, if any."""
        return self.start.with_values(self.added)

    @property
    def converged(self) -> bool:
        """Whether the search converged; if not, there are no standard errors."""
        return self.parameters.optimum.converged

    @property
    def fitted(self) -> tuple[FittedParameter, ...]:
        """Every free parameter of the rig, with its value in `rig`."""
        n_sensors = len(self.start.sensors)

        def of_rig(part: FittedParameter) -> bool:
            kind, index, *_ = part.paths[0].split(".")
            return kind != "sensors" or int(index) < n_sensors

        parts = filter(of_rig, self.parameters.fitted)
        return tuple(part if self.kept else part.as_it_came for part in parts)

    def __repr__(self) -> str:
        """Return the fit in a few words: logs, convergence, number of parameters, best scores."""
        count = sum(not part.noise for part in self.fitted)
        scores = [
            f"{name} {rounded(np.rad2deg(rms), 3)}° ({100 * inside:.0f} %)"
            for name, rms, inside in self.scores()[:2]
        ]
        left_out = f"; on logs left out: {', '.join(scores)}" if scores else ""
        ended = "converged" if self.converged else "not converged"
        return (
            f"Fit of '{self.start.name}' to {self.learned_from}, {ended}: {count} numbers{left_out}"
        )

    @property
    def learned_from(self) -> str:
        """The number of logs and their total duration in words: "4 logs of 80 s in all"."""
        return (
            f"{len(self.logs)} log{'s' if len(self.logs) > 1 else ''} of {self.duration:.0f} s "
            "in all"
        )

    def scores(self) -> list[tuple[str, float, float]]:
        """Return (name, mean RMS error [rad], mean share inside the band) on held-out logs, for
        each candidate and yardstick.

        The first row is what is written; the others follow from the least error up. A share is NaN
        where there is no band.
        """
        if not self.compared:
            return []
        names = [
            name
            for name in self.compared[0].scores
            if all(comparison.scores.get(name) for comparison in self.compared)
        ]
        rows = []
        for name in names:
            scores = [comparison.scores[name] for comparison in self.compared]
            ran = [score for score in scores if score is not None]
            rms, inside = np.mean([(score.rms, score.inside) for score in ran], axis=0)
            rows.append((name, float(rms), float(inside)))
        return sorted(rows, key=lambda row: (row[0] != WRITTEN, row[1]))

    def answer(self) -> str:
        """Return in a line how well each joint is known: band and error on held-out logs, beside
        the best way without a model of the rig; empty without held-out logs.
        """
        scores = [
            score
            for comparison in self.compared
            if (score := comparison.scores.get(WRITTEN)) is not None
        ]
        if np.isfinite(self.open_loop):
            error = np.rad2deg(self.open_loop)
            return f"with drives as recorded, joints err by {rounded(error)}° on logs left out"
        if not scores:
            return ""
        error = np.rad2deg(np.sqrt(np.mean([score.rms**2 for score in scores])))
        halves = np.rad2deg(np.nanmean([score.joint_halves for score in scores], axis=0))
        each = zip(self.rig.joint_names, halves.tolist())
        known = ", ".join(f"±{rounded(half)}° ({joint})" for joint, half in each)
        alone = [*YARDSTICKS, REGRESSION]
        modelless = [(rms, name) for name, rms, _ in self.scores() if name in alone]
        rms, name = min(modelless, default=(np.inf, ""))
        text = (
            f"on logs left out the joints are known to {known} at {COVERED_TEXT}, with an RMS "
            f"error of {rounded(error)}°"
        )
        least = f"{name}: {rounded(np.rad2deg(rms))}°"
        if rms * WORSE < self.scores()[0][1]:
            return f"another way errs less than what is written, {least}; {text}"
        return f"{text}; without a model of the rig the least is {least}" if modelless else text

    def advice(self) -> list[str]:
        """Return sentences on what to know before the rig is used: doubts, errors that no score
        shows, and advice.
        """
        errors = {candidate.name: candidate.error for candidate in self.candidates}
        lines = [f"doubt: {line}" for line in self.doubts]
        scores = self.scores()
        if scores and self.reference_offset > HIDDEN * scores[0][1]:
            offset = rounded(np.rad2deg(self.reference_offset))
            lines.insert(
                0,
                f"errors are beside the encoder, whose own zero may be off by {offset}° more "
                "(bias.std); the band contains that",
            )
        if self.part:
            before = np.rad2deg(errors.get(BY_EQUATIONS, np.inf))
            after = np.rad2deg(errors.get(f"{BY_EQUATIONS}, with {self.part}", np.inf))
            lines.insert(
                0,
                f"your rig lacks {self.part} ({rounded(before)}° → {rounded(after)}°): it is in "
                "the file",
            )
        for joint in self.rig.joints:
            if joint.external_torque.std > 0.0:
                torque = f"{1e3 * joint.external_torque.std:.3g} mN m"
                lines.append(
                    f"the torque from outside on {joint.name} ({torque}) also absorbs errors of "
                    "the rig, and the band "
                    "does not include what it may hide; declare it only where something can touch "
                    "the joint"
                )
        return lines

    def __getitem__(self, name: str) -> FittedParameter:
        """Return a fitted parameter by its name or its path, as in ``--set``.

        Raises:
            KeyError: the fit has no such parameter.
        """
        for part in self.fitted:
            if name == part.name:
                return part
        try:
            desired = set(paths_of(self.model, name))
            return next(part for part in self.fitted if desired <= set(part.paths))
        except (DistalError, StopIteration):
            raise KeyError(name) from None

    def save(self, path: str | Path, text: str | None = None) -> None:
        """Write the fitted rig file; if that fails, the old file is kept.

        The values are written into `text`, the TOML of the original rig, by default that of the
        result, so that its comments stay; without any the file is written anew.

        Raises:
            OutputError: the file cannot be written.
        """
        before = text if text is not None else self.text or None
        write_fitted(path, self.rig, self.start, self.assignments(), self._account(), before)

    def assignments(self) -> dict[str, object]:
        """Return path → value (with its std, where it had one) of all that the fit changed, as for
        `Rig.with_values`.
        """
        learned: dict[str, object] = {
            f"joints.{joint.name}.touch": joint.touch
            for joint, before in zip(self.rig.joints, self.start.joints, strict=True)
            if joint.touch != before.touch
        }
        if self.rig.left_out is not None:
            learned["left_out"] = plain_value(self.rig.left_out.model_dump())
        return {
            **self.added,
            **assignments(self.fitted, self.model, self.hold),
            **learned,
        }

    def _account(self) -> str:
        """Return the comment at the head of a fitted file: the logs, and what to know of it."""
        names = ", ".join(shown(name.rsplit("/", 1)[-1]) for name in self.logs)
        use = (
            ""
            if self.homing is None
            else f", as used with a reference for the first {self.homing:g} s"
        )
        lines = [f"{MARK}fit` to {self.learned_from}{use}:", f"# {names}"]
        if self.interrupted:
            lines.append("# The search was interrupted: these are the best values so far.")
        lines += [f"# {line}" for line in self.advice()]
        return "\n".join(lines) + "\n\n"


def _unknown(joints: Sequence[str]) -> list[str]:
    if not joints:
        return []
    return [
        f"the angle of {', '.join(joints)} is known in no log: parameters of the rig are fitted, "
        "but no map, which is of all joints"
    ]


def _as_given(chosen: Candidate, candidates: Sequence[Candidate]) -> list[str]:
    """Return a sentence where the rig as given errs least on held-out logs."""
    fitted = [candidate.error for candidate in candidates if candidate.parameters is not None]
    if not fitted or chosen.parameters is not None:
        return []
    return [
        f"{AS_GIVEN} errs less on held-out logs ({np.rad2deg(chosen.error):.2f}°) than the fitted "
        f"one ({np.rad2deg(min(fitted)):.2f}°): its parameters are kept"
    ]
