"""`fit`: learn a rig's parameters from logs, and test the result on held-out logs. `learn`: the
same from logs alone, without a rig file.

`Fit` is the result: values with standard errors, the origin of each, and the fitted rig. Its file
has values in their old positions, comments kept, and at the head an account of the fit.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from distal.confidence import BAND, COVERED_TEXT
from distal.errors import (
    DistalError,
    DistalWarning,
    DivergedError,
    EstimationError,
    FitError,
    OutputError,
    RigError,
)
from distal.fitting.candidates import (
    AS_GIVEN,
    BY_EQUATIONS,
    REGRESSION,
    WRITTEN,
    Candidate,
    Compared,
    Judged,
    Training,
    answer_maps,
    comparisons,
    groups_among,
    judge,
    parameters_without,
    with_terms,
)
from distal.fitting.learned_maps import (
    MapFit,
    Score,
    counted_from,
    efforts_of,
    reference_offset,
    reference_std,
    untouched,
)
from distal.fitting.parameter_search import (
    ParameterEstimates,
    by_filter,
    far_from_priors,
    problem_of,
)
from distal.fitting.parameters_and_priors import (
    FittedParameter,
    Options,
    Progress,
    assignments,
    paths_of,
)
from distal.fitting.usable_logs import (
    check_logs,
    delays,
    reference_lag,
    said_of_lag,
    touched_logs,
    without_lag,
)
from distal.from_logs import rig_from_logs
from distal.from_logs.drive_and_tendon_sizes import servos_of
from distal.homing import check_homing
from distal.logs import Log, Source, read_log, shown, true_angles, write_together
from distal.machine_limits import one_blas_thread
from distal.regression import FEWEST_LOGS, YARDSTICKS, folds_of, groups_of
from distal.rig import LeftOut, Rig, arrays_file, as_rig, as_table, build_rig, parse_toml, set_value
from distal.run import estimate
from distal.units import rounded

MARK = "# Fitted by `distal "
"""The first words of a fitted file; by them the head of an earlier fit is found and replaced."""


LEARNED = ("map", "left_out")
"""Tables that a fit writes; one that this fit did not learn is removed, since it belongs
to an earlier fit.
"""


def write_fitted(
    path: str | Path,
    rig: Rig,
    start: Rig,
    values: Mapping[str, object],
    head: str,
    text: str | None,
) -> None:
    """Write a fitted rig file, and beside it the numbers of its maps: both or none.

    If values in the old text would not read as this rig, the file is written anew, with a warning
    and without comments, so that no result is lost.

    Args:
        path: of the file.
        rig: the fitted rig.
        start: the original rig.
        values: path → value of what changed.
        head: comment at the head of the file, which begins with `MARK`.
        text: TOML of the original rig, whose comments stay; None writes the file anew.

    Raises:
        RigError: the text is not that of the original rig.
        OutputError: a file cannot be written, or not so that it reads as the same rig; what stood
            there is unchanged.
    """
    files: dict[Path, bytes | str] = {}
    table: dict[str, object] = {}
    if rig.map is not None:
        table["map"], files[arrays_file(path)] = as_table(rig.map, path)
    rig = rig.model_copy(update={"map": None})
    written = _anew(rig, table) if text is None else _edited(text, rig, start, {**values, **table})
    if written is None:
        warnings.warn(
            "the fitted values do not fit into the text of the rig file: the file is written anew, "
            "without its comments",
            DistalWarning,
            stacklevel=2,
        )
        written = _anew(rig, table)
    files[Path(path)] = head + written
    write_together(files)


def _edited(text: str, rig: Rig, start: Rig, values: Mapping[str, object]) -> str | None:
    """Return the text of the rig `start` with new values; None where it then does not read as the
    fitted rig.
    """
    if _read(text).bare() != start.bare():
        raise RigError("the text is not that of the rig that was fitted; save without it")
    with suppress(RigError):
        written = _put_into(text, rig, values)
        if _read(written) == rig:
            return written
    return None


def _put_into(text: str, rig: Rig, values: Mapping[str, object]) -> str:
    import tomlkit

    before = re.sub(rf"\A{MARK}.*\n(#.*\n)*\n*", "", text)  # without that of an earlier fit
    document = tomlkit.parse(before)
    for learned in LEARNED:
        if learned in document and not getattr(rig, learned):
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


def _anew(rig: Rig, table: Mapping[str, object]) -> str:
    """Return the TOML of a rig without maps, written anew, with the tables of its maps.

    Raises:
        OutputError: it does not read as this rig.
    """
    import tomlkit

    written = tomlkit.dumps(plain_value({**rig.model_dump(exclude_defaults=True), **table}))
    if _read(written) != rig:
        raise OutputError(
            f"{rig.name}: the fitted rig cannot be written so that it reads as the same"
        )
    return written


def _read(text: str) -> Rig:
    """Return the rig of a text, without its maps, whose numbers are elsewhere."""
    raw = parse_toml(text, "fitted rig", RigError)
    return build_rig({key: value for key, value in raw.items() if key != "map"}, "fitted rig")


def plain_value(raw: Any) -> Any:
    """Return a description as TOML can hold it: without empty values, and without the SI tags that
    reading finds again.
    """
    if isinstance(raw, Mapping):
        parts = raw.items()
        return {key: plain_value(part) for key, part in parts if part is not None and key != "si"}
    return [plain_value(part) for part in raw] if isinstance(raw, (list, tuple)) else raw


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
        parameters = chosen.parameters or judged.solutions[-1]
        maps = () if judged.line is None else answer_maps(chosen, training, judged.line)
        by_kind = {map_fit.kind: map_fit for map_fit in maps}
        ranked = sorted(judged.candidates, key=lambda way: (way is not chosen, way.error))
        added = {} if chosen.part is None else chosen.part.values
        logs = judged.logs
        doubts = list(parameters.doubts)
        if training.unknown:
            doubts.append(
                f"the angle of {', '.join(training.unknown)} is known in no log: parameters of the "
                "rig are fitted, but no map, which is of all joints"
            )
        doubts += chosen.refused
        if chosen.parameters is None:
            fitted = min(way.error for way in ranked if way.parameters is not None)
            doubts.append(
                f"{AS_GIVEN} errs less on held-out logs ({np.rad2deg(chosen.error):.2f}°) than the "
                f"fitted one ({np.rad2deg(fitted):.2f}°): its parameters are kept"
            )
        return cls(
            rig=chosen.rig.bare().with_map(**{kind: of.maps for kind, of in by_kind.items()}),
            start=training.rig,
            part="" if chosen.part is None else chosen.part.name,
            parameters=parameters,
            kept=chosen.parameters is not None,
            logs=tuple(log.source for log in logs),
            duration=float(sum(log.time[-1] - log.time[0] for log in logs)),
            homing=training.options.homing,
            interrupted=judged.interrupted,
            maps=by_kind,
            compared=comparisons(training, ranked, by_kind) if ranked else (),
            doubts=tuple(doubts),
            hold=chosen.hold,
            added=added,
            candidates=tuple(replace(candidate, data={}) for candidate in ranked),
            reference_std=reference_std(training.rig, logs),
            reference_offset=reference_offset(training.rig, logs),
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
        rows = []
        for name in self.compared[0].scores if self.compared else ():
            scores = self.scores_of(name)
            if len(scores) == len(self.compared):
                pairs = [(score.rms, score.inside) for score in scores]
                rms, inside = np.mean(pairs, axis=0).tolist()
                rows.append((name, rms, inside))
        return sorted(rows, key=lambda row: (row[0] != WRITTEN, row[1]))

    def scores_of(self, name: str) -> list[Score]:
        """Return the scores of a candidate or a yardstick on those held-out logs on which it
        runs.
        """
        scores = [comparison.scores.get(name) for comparison in self.compared]
        return [score for score in scores if score is not None]

    def answer(self) -> str:
        """Return in a line how well each joint is known: band and error on held-out logs, beside
        the best way without a model of the rig; empty without held-out logs.
        """
        scores = self.scores_of(WRITTEN)
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
        lines = []
        if self.part:
            errors = {candidate.name: candidate.error for candidate in self.candidates}
            before = np.rad2deg(errors.get(BY_EQUATIONS, np.inf))
            after = np.rad2deg(errors.get(f"{BY_EQUATIONS}, with {self.part}", np.inf))
            lines.append(
                f"your rig lacks {self.part} ({rounded(before)}° → {rounded(after)}°): it is in "
                "the file"
            )
        scores = self.scores()
        if scores and self.reference_offset > HIDDEN * scores[0][1]:
            offset = rounded(np.rad2deg(self.reference_offset))
            lines.append(
                f"errors are beside the encoder, whose own zero may be off by {offset}° more "
                "(bias.std); the band contains that"
            )
        lines += [f"doubt: {line}" for line in self.doubts]
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


PROMISED = 2.0
"""Ratio of a rig's error, or of its band, on a log that it was learned from to that on logs left
out, and of a filter's error to that of a straight line of the readings, above which it is not
written [1]. Source: definition (of what a fit promises).
"""


@one_blas_thread()
def fit(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    free: Sequence[str] | str = (),
    per_log: Sequence[str] | str = (),
    *,
    homing: float | None = None,
    noise: bool = True,
    truth: str | None = None,
    workers: int = 2,
    compiled: bool = True,
    progress: Progress | None = None,
    groups: str | None = None,
    lag: float | None = None,
    open_loop: bool = False,
    drafted: bool = False,
) -> Fit:
    """Fit a rig's parameters and noise to logs, learn a map of the angle error that remains, and
    test both on held-out logs.

    The parameters are the most likely ones: they minimise −ln p = ½ Σ w (ν²/(c S) + ln c S) − ln
    prior over all logs and channels, see `Problem` (prediction-error method; Ljung, 1999, ch. 7).
    The filter's angle is compared with the reference angle of a log; where the model explains the
    logs, the filter may read the reference too. With `homing` the filter reads the reference for
    that long, and only the errors afterwards count, as in use. With two logs of known angle or
    more, each way is judged on each of them by what the others tell. Logs that do not agree with
    the rig or with each other are fitted as well as possible, and the result says so.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`).
        rig: the description where the fit starts; its values and stds are the priors.
        free: paths of the parameters to fit, ``*`` for all components of a kind; default every
            parameter with a std.
        per_log: paths of the parameters that have one value for each log (pre-tension, zero
            offsets).
        homing: for how long the reference will be read in use [s]; None: it will not be read.
        noise: whether the sensors' noise is fitted too.
        truth: column of the true angle, where logs are read from files.
        workers: number of threads; the result does not depend on it.
        compiled: whether the filter is compiled; else it is interpreted.
        progress: called with what the fit is doing.
        groups: fit a *kind* of rig: a regular expression whose first parenthesis finds the group
            (an instrument, a pose, a day) in a log's name. The logs of a group are held out
            together, so that the band is right for a new one.
        lag: by how much the true angles are later than the drives [s]; None: it is found, and taken
            off where it makes the logs more probable by more than its standard error. A joint that
            follows its drives late looks the same.
        open_loop: whether the rig is for a simulator: its joints then go as in the logs where the
            drives do and no sensor corrects them. It has no maps.
        drafted: whether the rig was drafted from these logs: nothing is then said of values that
            are far from the draft's.

    Raises:
        FitError: the logs cannot be fitted; says which and why.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = as_rig(rig).bare()  # maps of an earlier fit are learned anew
    options = Options(
        free=_listed(free),
        per_log=_listed(per_log),
        homing=homing,
        noise=noise,
        groups=groups,
        workers=workers,
        compiled=compiled,
    )
    read = _read_and_checked(logs, rig, truth, homing, drafted)
    touched = [] if homing is not None or groups is not None else touched_logs(read, rig)
    aside = [read[i] for i in touched]
    read = [log for i, log in enumerate(read) if i not in touched]
    if groups is not None:
        groups_of([log.source for log in read], groups)
    found_lag = _lag(read, rig, groups) if lag is None else lag
    if open_loop and all(true_angles(log, rig.joint_names) is None for log in read):
        raise FitError(
            "an open loop is fitted to the joints' angles, and no log has them; log them too, by a "
            "camera or a temporary encoder"
        )
    judged = _judged_at(found_lag, read, rig, options, progress)
    if not found_lag or lag is not None:
        judged = with_terms(judged, progress)
    elif not judged.interrupted:
        # what looks late to the readings may be inertia, which the filter knows
        on_time = with_terms(_judged_at(0.0, read, rig, options, progress), progress)
        if on_time.error < judged.error:
            judged = on_time
            found_lag = 0.0
        else:
            judged = with_terms(replace(judged, interrupted=on_time.interrupted), progress)
    read = list(judged.logs)
    measured = {**servos_of(read, rig), **delays(read, rig, found_lag)}
    learned = _followed(judged, read)
    if open_loop and not learned.interrupted:
        learned = _in_open_loop(learned, judged.training, progress)
    doubts = said_of_lag(found_lag)
    if aside:
        names = ", ".join(shown(log.source) for log in aside)
        doubts.append(
            f"in {names} something touches a joint, or holds it: the same positions of the drives "
            "go with other angles than in the other logs. What is learned of the rig is of free "
            "motion, so they are left out; a log of another kind of motion is fitted where there "
            "are several"
        )
    parameters = learned.parameters
    for line in () if drafted else far_from_priors(parameters.fitted, parameters.problem):
        warnings.warn(line, DistalWarning, stacklevel=2)
    return replace(
        learned, start=rig, added={**measured, **learned.added}, doubts=(*doubts, *learned.doubts)
    )


def _judged_at(
    lag: float, logs: Sequence[Log], rig: Rig, options: Options, progress: Progress | None
) -> Judged:
    """Return the candidates where the reference is later than the drives by a lag [s]."""
    on_time = without_lag(logs, rig, lag)
    measured = {**servos_of(on_time, rig), **delays(on_time, rig, lag)}
    return judge(on_time, rig.with_values(measured), options, progress)


def _followed(judged: Judged, logs: Sequence[Log]) -> Fit:
    """Return what is learned by the best candidate, with its normal forces of free motion; where
    the rig, as it would be written, fails on a log, by the next one, and at last by readings alone.

    Candidates are judged without touches. So a rig that looks for none comes before another one.
    """
    best = judged.chosen
    line = judged.training.line_error
    # why no filter is written; of a filter that others replace nobody asks
    doubts = list[str]()
    with suppress(KeyboardInterrupt):  # what was learned stands
        for candidate in sorted(judged.candidates, key=lambda way: way.error) or [best]:
            if PROMISED * line < candidate.error < np.inf:
                doubts.append(
                    f"the filter of {candidate.name} errs by {np.rad2deg(candidate.error):.2g}° on "
                    f"logs left out, a straight line of the readings by {np.rad2deg(line):.2g}°"
                )
                continue
            learned = _with_free_motion(Fit.of(judged, candidate), judged)
            for rig in dict.fromkeys((learned.rig, untouched(learned.rig))):
                failures = (_failure(rig, log, learned, judged.training) for log in logs)
                failure = next(filter(None, failures), None)
                if failure is None:
                    return replace(learned, rig=rig)
                touches = "" if rig is learned.rig else ", which looks for no touches,"
                doubts.append(f"the filter of {candidate.name}{touches} {failure}")
        doubts.append("no filter is written: the angles are those of the map on readings alone")
        best = replace(best, data={})
        learned = _with_free_motion(Fit.of(judged, best), judged)
        return replace(learned, doubts=(*doubts, *learned.doubts))
    return Fit.of(judged, best)


def _in_open_loop(learned: Fit, training: Training, progress: Progress | None) -> Fit:
    """Return what was learned with the parameters for an open loop in place of those for an
    estimator, and without maps (output-error method; Ljung, System Identification, 1999, ch. 7).
    """
    logs = training.logs
    options = replace(training.options, noise=False)

    problem = replace(problem_of(logs, learned.model, options), open_loop=True)
    parameters = by_filter(problem, None, progress)
    interrupted = parameters.optimum.interrupted
    error = np.nan
    if len(set(training.folds)) > 1 and not interrupted:
        try:
            of_folds = parameters_without(parameters, logs, training.folds)
            ends = [of_folds[fold].optimum.z for fold in training.folds]
            runs = parameters.problem.run([(i, z[problem.columns(i)]) for i, z in enumerate(ends)])
        except KeyboardInterrupt:
            interrupted = True
        else:
            late = [
                run.values[log.time - log.time[0] >= counted_from(log, options.homing)]
                for log, run in zip(logs, runs)
            ]
            squares = [np.nanmean(of_log**2) for of_log in late if np.isfinite(of_log).any()]
            error = float(np.sqrt(np.mean(squares)))
    return replace(
        learned,
        rig=parameters.put_into(learned.model),
        parameters=parameters,
        kept=True,
        hold=False,
        maps={},
        compared=(),
        doubts=parameters.doubts,
        interrupted=interrupted,
        open_loop=error,
    )


def _failure(rig: Rig, log: Log, learned: Fit, training: Training) -> str | None:
    """Return in words how a rig fails on a log that it was learned from; None where it does not."""
    options = training.options
    homing = options.homing
    try:
        result = estimate(log, rig, compiled=options.compiled, homing=homing, covariances=False)
    except DivergedError:
        return f"leaves all bounds on {shown(log.source)}"
    scores = {of_log.index: of_log.scores[WRITTEN] for of_log in learned.compared}
    index = next((i for i, known in enumerate(training.logs) if known is log), -1)
    score = scores.get(index)
    if score is None:
        return None
    every = [of_log for of_log in scores.values() if of_log is not None]
    # no score has the zero of the encoder
    mean = np.sqrt(np.mean([of_log.rms**2 for of_log in every]))
    promised = np.hypot(max(score.rms, mean), reference_offset(rig, [log]))
    late = log.time - log.time[0] >= counted_from(log, homing)
    errors = result.errors().reshape(len(log), -1)[late]
    rms = float(np.sqrt(np.nanmean(errors**2)))
    half = BAND * float(np.mean(result.angle_stds[late]))
    wide = half > PROMISED * max(of_log.half for of_log in every)
    if rms <= PROMISED * promised and not wide:
        return None
    now, before = np.rad2deg((half, score.half) if wide else (rms, score.rms))
    what = "knows the angle to ±" if wide else "errs by "
    return f"{what}{now:.2g}° on {shown(log.source)}, where left out it had {before:.2g}°"


def _lag(logs: Sequence[Log], rig: Rig, groups: str | None) -> float:
    """Return the lag of the reference [s]; 0 where the map on readings cannot run."""
    with_reference = [log for log in logs if true_angles(log, rig.joint_names) is not None]
    try:
        of_logs = groups_among(with_reference, groups)
        return reference_lag(with_reference, rig, folds_of(of_logs))
    except EstimationError:
        return 0.0


def _with_free_motion(learned: Fit, judged: Judged) -> Fit:
    """Return what was learned, with the normal forces of free motion (`efforts_of`), and how well
    the rig did on logs left out, where these are not few.
    """
    folds = folds_of(groups_among(judged.logs, judged.training.options.groups))
    rig = learned.rig.with_map(efforts=efforts_of(judged.logs, learned.rig, folds))
    ran = learned.scores_of(WRITTEN)
    if len(ran) >= FEWEST_LOGS:
        rms = float(np.sqrt(np.mean([score.rms**2 for score in ran])))
        inside = float(np.mean([score.inside for score in ran]))
        left_out = LeftOut(logs=len(ran), rms=rms, inside=inside)
        rig = rig.model_copy(update={"left_out": left_out})
    return replace(learned, rig=rig)


def _read_and_checked(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig,
    truth: str | None,
    homing: float | None,
    drafted: bool,
) -> list[Log]:
    """Return the logs, read and checked."""
    if not rig.sensors:
        raise FitError(
            "the rig has no sensors, so no log can be used for a fit; describe them in [[sensors]]"
        )
    if homing is not None and not isinstance(homing, (int, float)):
        raise FitError(f"homing is a number of seconds, {homing!r} came")
    sources = [logs] if isinstance(logs, (Log, str, Path)) else logs
    read = [log if isinstance(log, Log) else read_log(log, rig, truth) for log in sources]
    check_logs(read, rig, drafted)
    if homing is not None:
        for log in read:
            check_homing(homing, log, rig.joint_names)
    return read


def _listed(paths: Sequence[str] | str) -> tuple[str, ...]:
    return (paths,) if isinstance(paths, str) else tuple(paths)


def learn(
    logs: Sequence[Source],
    *,
    truth: Sequence[str] = (),
    drives: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    rate: float | None = None,
    lag: float | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Learn from logs alone how well the joints can be known from the motors: which columns are
    what, the structure of the rig, its parameters and its maps.

    `Fit.answer` says how well, `Fit.save` writes the rig file, and `estimate` takes `Fit.rig`.

    Args:
        logs: paths or frames with the same columns; three of 20 to 40 s with the joints' angles are
            enough.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        rate: of evenly spaced rows, where no column holds their time [Hz].
        lag: by how much the true angles are later than the drives [s]; see `fit`.
        progress: called with what the fit is doing.

    Raises:
        LogError: a log cannot be read, or has no time.
        RigError: no drive or no joint can be found; says what would help.
        FitError: the logs cannot be fitted.
    """
    draft = rig_from_logs(logs, truth=truth, drives=drives, ignore=ignore, rate=rate)
    read = [read_log(source, draft.rig) for source in logs]
    result = fit(read, draft.rig, progress=progress, lag=lag, drafted=True)
    return replace(result, text=draft.text)
