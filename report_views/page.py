"""A report as one page of HTML that needs nothing else: what it shows, the data it shows, and the farm's word for them.

It is one thing and over 200 lines because the page is a function of the data alone, so that whoever holds a page can make it
again from the data inside and see whether somebody changed what it shows.
"""

import hashlib
import json
import math
from base64 import b64encode
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from html import escape
from typing import Any

from api_schemas.report import Report, RobotRow, TrialRow
from api_schemas.scene_form import told_forms
from api_schemas.signature import Signature
from api_schemas.success_rate import SHOWN, SHOWN_LEVEL, wilson
from api_schemas.tolerance import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M
from api_schemas.tracker import told_trackers
from api_schemas.trial import Fault, OutcomeKind
from api_schemas.visible import visible
from report_views import error_axis

MAKER = "trifarm report page 4"
"""The maker of new pages. Pages of an earlier one stay signed, so that they are drawn again in its own words."""
DATA_ID = "trifarm-signed-report"
STYLE = """
:root{color-scheme:light dark;--ink:light-dark(#17201c,#e8eeea);--soft:light-dark(#55615b,#a3b0a9);
--line:light-dark(#dfe3df,#2f3833);--bar:light-dark(#9ccbc6,#2f7069);--ok:light-dark(#1f7a4d,#57c98a);--not:light-dark(#b3372f,#ff8f85)}
body{font:15px/1.55 system-ui,"Segoe UI",Roboto,"Noto Sans","DejaVu Sans",sans-serif;color:var(--ink);
background:light-dark(#fff,#151a17);max-width:860px;margin:0 auto;padding:40px 24px 64px}
h1{font-size:27px;line-height:1.25;letter-spacing:-.015em;margin:0;overflow-wrap:anywhere}
h2{font-size:17px;margin:36px 0 10px}
.soft{color:var(--soft)}.number{font-size:56px;font-weight:650;letter-spacing:-.03em;line-height:1.1;margin:22px 0 0}
table{border-collapse:collapse;width:100%;font-size:13.5px}
td,th{text-align:left;padding:5px 12px 5px 0;border-bottom:1px solid var(--line);vertical-align:top}
.n{text-align:right;font-variant-numeric:tabular-nums}th{font-weight:500;color:var(--soft)}
code{font:12.5px ui-monospace,Menlo,Consolas,"DejaVu Sans Mono",monospace;overflow-wrap:anywhere}
svg{display:block;width:100%}.b{fill:var(--bar)}.g{fill:var(--line)}.w{stroke:var(--ink);fill:none;stroke-width:1.5}
.ok{fill:var(--ok)}.not{fill:var(--not)}text{fill:var(--soft);font-size:11px}
.bar{width:220px;height:14px}.wrap{overflow-x:auto}dl{display:grid;grid-template-columns:max-content 1fr;gap:4px 22px;margin:0}
dt{color:var(--soft)}dd{margin:0;overflow-wrap:anywhere}
@media(max-width:560px){dl{grid-template-columns:1fr}dt{margin-top:6px}body{padding:24px 16px}.bar{width:110px}}
"""
PHONE_STYLE = """.limit{stroke:var(--ink);stroke-dasharray:5 4;fill:none}
@media(max-width:560px){.cards,.cards tbody,.cards tr,.cards td{display:block}.cards tr:first-child{display:none}
.cards tr{border:1px solid var(--line);border-radius:10px;padding:8px 12px;margin-bottom:10px}
.cards td{border:0;padding:2px 0;text-align:left;display:flex;gap:10px;overflow-wrap:anywhere}.cards td:empty{display:none}
.cards td[data-is]::before{content:attr(data-is);color:var(--soft);flex:0 0 84px}}
"""
"""Tables as cards on a phone, and the limit beside errors: of pages of maker 3 and later."""


def style_source(maker: str = MAKER) -> str:
    """What a content security policy has to say for the style of a maker's pages."""
    return f"'sha256-{b64encode(hashlib.sha256(MAKERS[maker].style.encode()).digest()).decode()}'"


SEQUENCE = "of the rate: a confidence sequence, holding at every look, since a question may have ended the job; of robots: Wilson"


@dataclass(frozen=True)
class _Words:
    """The sentences that differ from one maker to the next."""

    errors: Callable[[Report], str]
    attempts: str
    intervals: str
    style: str = STYLE
    cards: bool = False
    both_levels: bool = True
    """Whether rates have intervals of 80 % too, and robots those alone."""

    @property
    def of_robots(self) -> str:
        """What the intervals of robots are called."""
        return "80 % interval" if self.both_levels else SHOWN

    def cell(self, name: str, *, is_number: bool = False) -> str:
        """The beginning of a cell, with the name of its column where a phone shows no heads of tables."""
        kind, named = ' class="n"' if is_number else "", f' data-is="{name}"' if self.cards else ""
        return f"<td{kind}{named}>"

    @property
    def table(self) -> str:
        """The beginning of a table."""
        return '<table class="cards">' if self.cards else "<table>"


def _errors_of_policy_and_platform(report: Report) -> str:
    policy = f"{report.policy_faults} policy error{'' if report.policy_faults == 1 else 's'} (counted as failures)"
    platform = f"{report.platform_faults} platform error{'' if report.platform_faults == 1 else 's'} (retried, not counted)"
    return f"{policy} · {platform}"


MAKERS: dict[str, _Words] = {
    "trifarm report page 1": _Words(
        lambda report: (
            f"{report.policy_faults} ended by the policy's fault (counted as failures) · "
            f"{report.platform_faults} attempts by the platform's (not counted)"
        ),
        "Attempts that failed by the platform's fault",
        "Wilson's score interval; every accepted trial counts, platform faults were tried again",
    ),
    "trifarm report page 2": _Words(
        _errors_of_policy_and_platform,
        "Platform errors",
        "Wilson's score interval; every accepted trial counts, attempts with a platform error were retried",
    ),
}
MAKERS["trifarm report page 3"] = replace(MAKERS["trifarm report page 2"], style=STYLE + PHONE_STYLE, cards=True)
MAKERS[MAKER] = replace(MAKERS["trifarm report page 3"], both_levels=False)


def render_page(report: Report, signature: Signature, maker: str = MAKER) -> str:
    """The whole page; whatever a user named is escaped.

    Raises:
        KeyError: there is no such maker.
    """
    return "\n".join(_lines(report, signature, maker)) + "\n"


def _lines(report: Report, signature: Signature, maker: str) -> Iterator[str]:
    words = MAKERS[maker]
    yield "<!doctype html>"
    yield '<html lang="en"><head><meta charset="utf-8">'
    yield f'<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; style-src {style_source(maker)}">'
    yield f'<meta name="generator" content="{maker}"><meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<title>{_text(report.policy_name)}: {report.task} · report of job {_text(report.job_id)}</title>"
    yield f"<style>{words.style}</style></head><body><main>"
    yield from _section("result", _result(report, words))
    yield from _section("robots", _robots(report, words))
    yield from _section("errors", _errors(report, words))
    yield from _section("trials", _trials(report, words))
    yield from _section("methods", _methods(report, words))
    yield from _section("signature", _signature(report, signature))
    yield "</main>"
    # Only what was read: what later versions know besides is not what was signed.
    data = {"report": report.model_dump(mode="json", exclude_unset=True), "signature": signature.model_dump(mode="json")}
    yield f'<script type="application/json" id="{DATA_ID}">{_embedded(data)}</script>'
    yield "</body></html>"


def _section(name: str, lines: Iterator[str]) -> Iterator[str]:
    yield f'<section id="{name}">'
    yield from lines
    yield "</section>"


def _embedded(data: dict[str, Any]) -> str:
    """JSON that ends no element, whatever it says."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _result(report: Report, words: _Words) -> Iterator[str]:
    yield f"<h1>{_text(report.policy_name)}</h1>"
    what = f"{report.trials} trials of {report.task}{_object(report)}"
    yield f'<p class="soft">{what} · job <code>{_text(report.job_id)}</code></p>'
    yield f'<p class="number">{100 * report.success_rate:.0f} %</p>'
    yield f"<p>{report.successes} of {report.trials} trials succeeded · {_intervals(report, words)}</p>"
    if report.question is not None:
        yield f"<p><b>{_text(report.question.sentence)}</b></p>"
    if report.own_goals:
        yield '<p class="soft">The job\'s user brought its goals; leaderboards do not take them.</p>'
    shown = report.interval_80 if words.both_levels else report.interval_95
    yield _bar(report.success_rate, shown, 'viewBox="0 0 100 6" preserveAspectRatio="none" height="18"', 6)
    ever = f"Reached at any time in {report.success_ever}"
    yield f'<p class="soft">{ever} · {words.errors(report)}</p>'


def _intervals(report: Report, words: _Words) -> str:
    low, high = (_percent(bound) for bound in report.interval_95)
    if not words.both_levels:
        return f"{SHOWN} <b>{low}–{high} %</b>"
    lower, upper = (_percent(bound) for bound in report.interval_80)
    return f"80 % interval <b>{lower}–{upper} %</b> · 95 % interval {low}–{high} %"


def _object(report: Report) -> str:
    usual = report.object == "cube" and report.object_scale == 1.0
    return "" if usual else f" with {_text(report.object)}, {report.object_scale:g} × its usual size"


def _robots(report: Report, words: _Words) -> Iterator[str]:
    heads = '<tr><th>robot</th><th class="n">trials</th><th class="n">succeeded</th>'
    yield f'<h2>By robot</h2><div class="wrap">{words.table}{heads}'
    yield f'<th class="n">rate</th><th>{words.of_robots}</th><th></th></tr>'
    yield from (_robot(row, words) for row in report.per_robot)
    yield "</table></div>"
    if report.between_robots is not None:
        lower, upper = report.between_robots.interval_80
        share = f"{100 * report.between_robots.variance_share:.0f} % of the variance of success lies between robots"
        yield f'<p class="soft">{share} (80 % interval {_percent(lower)}–{_percent(upper)} %).</p>'


def _robot(row: RobotRow, words: _Words) -> str:
    low, high = row.interval_80 if words.both_levels else wilson(row.successes, row.trials, SHOWN_LEVEL)
    numbers = {"trials": f"{row.trials}", "succeeded": f"{row.successes}", "rate": f"{row.success_rate:.2f}"}
    cells = "".join(f"{words.cell(name, is_number=True)}{number}</td>" for name, number in numbers.items())
    bar = _bar(row.success_rate, (low, high), 'class="bar" viewBox="0 0 100 6" preserveAspectRatio="none"', 6)
    interval = f"{words.cell(words.of_robots)}{low:.2f}–{high:.2f}</td>"
    return f"<tr>{words.cell('robot')}{_text(row.robot)}</td>{cells}{interval}<td>{bar}</td></tr>"


def _bar(rate: float, interval: tuple[float, float], attributes: str, height: int) -> str:
    low, high = (f"{100 * bound:.2f}" for bound in interval)
    middle = height / 2
    whisker = f"M{low} {middle}H{high}M{low} 1V{height - 1}M{high} 1V{height - 1}"
    return (
        f'<svg {attributes} role="img" aria-label="{100 * rate:.0f} %"><rect class="g" width="100" height="{height}"/>'
        f'<rect class="b" width="{100 * rate:.2f}" height="{height}"/>'
        f'<path class="w" vector-effect="non-scaling-stroke" d="{whisker}"/></svg>'
    )


def _errors(report: Report, words: _Words) -> Iterator[str]:
    measured = [row for row in report.per_trial if row.outcome.measures is not None]
    yield "<h2>How far from the goal the trials ended</h2>"
    if not measured:
        yield '<p class="soft">Nothing was measured.</p>'
        return
    label = f"Final position error of {len(measured)} trials in millimetres, on a logarithmic scale"
    yield f'<svg viewBox="0 0 800 130" role="img" aria-label="{label}">'
    for tick in error_axis.TICKS_MM:
        x = _error_x(tick)
        yield f'<path stroke="#8886" d="M{x:.1f} 0V108"/><text x="{x:.1f}" y="124" text-anchor="middle">{tick} mm</text>'
    if words.cards:
        limit_mm = 1e3 * POSITION_TOLERANCE_M
        yield f'<path class="limit" d="M{_error_x(limit_mm):.1f} 0V108"><title>the limit, {limit_mm:.0f} mm</title></path>'
    for index, row in enumerate(measured):
        assert row.outcome.measures is not None, "only measured rows are here"
        x, y = _error_x(1e3 * row.outcome.measures.final_position_error_m), 12 + 84 * error_axis.across(index)
        word = "ok" if row.outcome.kind == OutcomeKind.SUCCEEDED else "not"
        yield f'<circle class="{word}" cx="{x:.1f}" cy="{y:.1f}" r="4.5" opacity=".75"><title>trial {row.trial}</title></circle>'
    yield "</svg>"
    if words.cards:
        yield f'<p class="soft">Dashed: the limit of {1e3 * POSITION_TOLERANCE_M:.0f} mm.</p>'


def _error_x(error_mm: float) -> float:
    return 24 + 752 * error_axis.along(error_mm)


def _trials(report: Report, words: _Words) -> Iterator[str]:
    yield f'<h2>Trials</h2><div class="wrap">{words.table}<tr><th class="n">trial</th><th>robot</th><th>outcome</th>'
    yield '<th class="n">error mm</th><th class="n">angle °</th><th class="n">tries</th><th>why</th></tr>'
    yield from (_trial(row, words) for row in report.per_trial)
    yield "</table></div>"
    if len(report.per_trial) < report.trials:
        yield f'<p class="soft">The first {len(report.per_trial)} of {report.trials} trials.</p>'
    if report.failures:
        yield '<h2>Why trials failed</h2><table><tr><th>kind</th><th class="n">trials</th><th>the first of them</th></tr>'
        for group in report.failures:
            kind = _text(group.kind.replace("_", " "))
            yield f'<tr><td>{kind}</td><td class="n">{len(group.trials)}</td><td>{_text(group.sentence)}</td></tr>'
        yield "</table>"
    if report.platform_fault_attempts:
        yield f"<h2>{words.attempts}</h2><ul>"
        for fault in report.platform_fault_attempts:
            yield f"<li>trial {fault.trial}, attempt {fault.attempt} on {_text(fault.robot)}: {_text(fault.reason)}</li>"
        yield "</ul>"


def _trial(row: TrialRow, words: _Words) -> str:
    measures = row.outcome.measures
    error = "–" if measures is None else f"{1e3 * measures.final_position_error_m:.1f}"
    turned = None if measures is None else measures.final_angle_error_rad
    angle = "–" if turned is None else f"{math.degrees(turned):.1f}"
    succeeded = row.outcome.kind == OutcomeKind.SUCCEEDED
    whose = "" if row.outcome.fault == Fault.NONE else f" ({row.outcome.fault}'s fault)"
    told = row.outcome.reason if row.outcome.failure is None else row.outcome.failure.sentence
    why = "" if succeeded else _text(told)
    ended = f"{words.cell('robot')}{_text(row.robot)}</td>{words.cell('outcome')}{_text(row.outcome.kind)}{whose}</td>"
    known = {"error mm": error, "angle °": angle, "tries": f"{row.attempts}"}
    numbers = "".join(f"{words.cell(name, is_number=True)}{number}</td>" for name, number in known.items())
    return f"<tr>{words.cell('trial', is_number=True)}{row.trial}</td>{ended}{numbers}{words.cell('why')}{why}</td></tr>"


def _methods(report: Report, words: _Words) -> Iterator[str]:
    turned = any(row.outcome.measures and row.outcome.measures.final_angle_error_rad is not None for row in report.per_trial)
    angle = f" and {math.degrees(ANGLE_TOLERANCE_RAD):.0f}° of its orientation" if turned else ""
    yield "<h2>Methods</h2><dl>"
    yield from _row("success", f"at the trial's end within {1e3 * POSITION_TOLERANCE_M:.0f} mm of the goal{angle}")
    yield from _row("intervals", words.intervals if report.intervals == "wilson" else SEQUENCE)
    yield from _row("robots", f"{len(report.per_robot)}, drawn for each trial by the job's seed")
    yield from _row("seed", str(report.seed))
    yield from _row("policy", f"<code>{_text(report.policy)}</code> (SHA-256)")
    if report.jail is not None:
        yield from _row("jail of the policy", f"{_text(report.jail.level)}: {_text(', '.join(report.jail.layers))}")
    if report.timing is not None:
        keeps = "keeps its rate" if report.timing.keeps_rate else "would not keep its rate on hardware"
        late = f"{report.timing.missed} of {report.timing.actions} actions took over {report.timing.allowed_ms:g} ms"
        yield from _row("policy timing", f"{keeps}; {late}, 99th percentile {report.timing.p99_ms:.2f} ms")
    yield from _row(
        "queued, started, ended", f"{_text(report.created_at)}, {_text(report.started_at or '–')}, {_text(report.ended_at)}"
    )
    if report.forms:  # reports of 0.1.0 tell none, and their pages stay as they were signed
        yield from _row("form of the scene", _text(told_forms(report.forms)))
    if report.trackers:
        yield from _row("tracker", _text(told_trackers(report.trackers)))
    yield from _row("versions", _text(", ".join(f"{name} {value}" for name, value in sorted(report.versions.items()))))
    yield "</dl>"


def _signature(report: Report, signature: Signature) -> Iterator[str]:
    logs = sum(row.log_sha256 is not None for row in report.per_trial)
    yield "<h2>Signature</h2>"
    yield f'<p class="soft">Signed with the SHA-256 of the policy, of {logs} logs and of each part of this report. '
    yield "<code>trifarm verify FILE</code> checks this page without a connection.</p><dl>"
    yield from _row("key of the farm", f"<code>{signature.key}</code>")
    yield from _row("report", f"<code>{signature.report_sha256}</code> (SHA-256)")
    yield from _row("signature (Ed25519)", f"<code>{signature.signature}</code>")
    yield "</dl>"


def _row(name: str, value: str) -> Iterator[str]:
    yield f"<dt>{name}</dt><dd>{value}</dd>"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.0f}"


def _text(value: object) -> str:
    return escape(visible(str(value)), quote=True)
