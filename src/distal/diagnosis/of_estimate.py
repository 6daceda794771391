"""Diagnosis of an estimate in one line: what disagrees, else what was tested and what was not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from distal.diagnosis.channel_statistics import ChannelStatistics, channel_statistics_of
from distal.diagnosis.finding import Finding
from distal.diagnosis.states import left_their_priors, turning_too_far, undeclared_friction
from distal.results.estimate import Estimate

LONGEST = 200
"""Largest number of characters of the line, roughly. Source: layout."""

NOTHING = (
    "not checked: no sensor is compared (this estimator has no innovations, or the rig no "
    "force sensor)"
)


@dataclass(frozen=True)
class Diagnosis:
    """What a log says of the rig, the sensors and the band.

    Args:
        channels: names of the channels with an innovation.
        ratios: mean of ν²/S per channel; 1 is expected, less where a force tells little.
        correlations: of neighbouring normalised innovations, per channel.
        since: time from which on a channel disagrees to the end [s], or NaN, per channel.
        text: the diagnosis in one line.
        findings: contradictions first, then what is untested.
        tested: names of the channels that could have disagreed.
    """

    channels: tuple[str, ...]
    ratios: tuple[float, ...]
    correlations: tuple[float, ...]
    since: tuple[float, ...]
    text: str
    findings: tuple[Finding, ...] = ()
    tested: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Return the line."""
        return self.text

    @property
    def headline(self) -> str:
        """The line up to its first colon: the result without the reasons."""
        return self.text.split(":")[0]

    @property
    def untested(self) -> bool:
        """Whether nothing was tested and nothing contradicts."""
        return not self.tested and not any(finding.contradicts for finding in self.findings)

    @property
    def consistent(self) -> bool:
        """Whether something was tested and nothing contradicts."""
        return bool(self.tested) and not any(finding.contradicts for finding in self.findings)


def diagnose_estimate(
    estimate: Estimate, further: Sequence[Finding] = (), channels: ChannelStatistics | None = None
) -> Diagnosis:
    """Return what the innovations and states of an estimate say, together with findings by other
    means; see `distal.diagnose`.

    Args:
        estimate: to be diagnosed.
        further: findings by other means.
        channels: statistics of the innovations; by default those of the estimate, else those of a
            filter that began with what it learned (`with_learned_parameters`).
    """
    channels = channel_statistics_of(estimate) if channels is None else channels
    states = [
        *left_their_priors(estimate),
        *turning_too_far(estimate),
        *undeclared_friction(estimate),
    ]
    # what would explain it comes right after what disagrees, before what follows from it
    looks = [finding for finding in further if finding.kind == "looks like"]
    truth = [finding for finding in further if finding.kind == "against the truth"]
    consequences = [
        finding for finding in further if finding.kind not in ("looks like", "against the truth")
    ]
    # the truth has the last word, so it is said first
    findings = [
        *truth,
        *(looks if truth else ()),
        *channels.findings(),
        *(() if truth else looks),
        *states,
        *consequences,
    ]
    contradicting = [finding for finding in findings if finding.contradicts]
    silent = [finding for finding in findings if not finding.contradicts]
    statistics = channels.names, channels.ratios, channels.correlations, channels.since
    text = _text(contradicting, silent, channels)
    return Diagnosis(*statistics, text, (*contradicting, *silent), channels.tested)


def _text(
    contradicting: Sequence[Finding], silent: Sequence[Finding], channels: ChannelStatistics
) -> str:
    tested = channels.tested
    not_tested = [finding for finding in silent if finding.kind == "not tested"]
    hardly = [finding.text for finding in silent if finding.kind == "hardly compared"]
    if contradicting:
        return _joined([finding.text for finding in contradicting] + hardly)
    beyond = [finding.subject for finding in silent if finding.kind == "cannot test"]
    explained = [finding.text for finding in silent if finding.kind == "would explain"]
    # an error that the band allows is said first, with its likeliest cause
    held = [
        ": ".join([finding.text, *explained[:1]])
        for finding in silent
        if finding.kind == "errs inside"
    ]
    held += explained[1:]
    if not channels.names:
        return _joined([*held, NOTHING], beyond)
    if not tested:
        small = [finding.text for finding in not_tested] or [
            "not tested: hardly anything could be compared"
        ]
        return _joined([*held, *small, *hardly], beyond)
    least = min(share for name, share in zip(channels.names, channels.shares) if name in tested)
    agree = (
        f"{', '.join(tested)} agree{'s' * (len(tested) == 1)} with the rig, {100 * least:.0f} "
        "% compared"
    )
    silence = (
        [f"not tested by {', '.join(finding.subject for finding in not_tested)}"]
        if not_tested
        else []
    )
    return _joined([*held, agree if held else f"consistent: {agree}", *hardly, *silence], beyond)


def _joined(parts: Sequence[str], beyond: Sequence[str] = ()) -> str:
    """Return the parts and what cannot be tested as one line; parts that do not fit are counted,
    and the list of what cannot be tested is cut.
    """
    line = parts[0]
    cannot = f"cannot test: {'; '.join(beyond)}"
    more = [*parts[1:], cannot] if beyond else parts[1:]
    for k, part in enumerate(more):
        if len(line) + len(part) + 2 > LONGEST:
            room = LONGEST - len(line) - 10
            cut = part[: max(room, 0)].rpartition("; ")[0]
            if cut and part is cannot:
                return f"{line}; {cut}; …"
            return f"{line}; and {len(more) - k} more (--findings)"
        line = f"{line}; {part}"
    return line
