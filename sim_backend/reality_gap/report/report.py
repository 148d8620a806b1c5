"""The report of a study: sentences for the console, and one page that needs nothing but a browser."""

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from sim_backend.reality_gap.report.canvas import Plot, drawing
from sim_backend.reality_gap.report.comparisons import confusability_plot, ladder_plot, ranking_plot, success_plot
from sim_backend.reality_gap.report.curves import autocorrelation_plot, horizon_plot, profile_plot, worst_window_plot
from sim_backend.reality_gap.report.numbers import count, number, quantity_with_interval, real
from sim_backend.reality_gap.report.page import PAGE, STYLE
from sim_backend.reality_gap.report.residuals import residual_plots
from sim_backend.reality_gap.report.sentences import (
    Document,
    cause_sentences,
    data_sentence,
    effect_name,
    evidence_sentences,
    headline,
    kind_of,
    parameter_name,
    sentence,
    words,
)

CANNOT_TELL, RECORD_NEXT = "What this cannot tell", "Record this next"


def summary_lines(document: Document) -> list[str]:
    """What the study found, for the console: one sentence a line, the verdict first.

    Args:
        document: the ``study.json`` of a study, as read or as built.
    """
    title = words(document.get("title", ""))
    lines = [f"{title}: {headline(document)}" if title else headline(document), *_told(document)]
    for heading, items in _advice(document):
        lines += [f"{heading}:", *(f"  - {sentence(item)}" for item in items)]
    return lines


def write_html(document: Document, path: Path) -> None:
    """Write the page; the same document gives the same bytes.

    Args:
        document: the ``study.json`` of a study, as read or as built.
        path: of the page.
    """
    path.write_text(html_page(document), encoding="utf-8")


def html_page(document: Document) -> str:
    """The page as text: no script runs in it and nothing is loaded from anywhere."""
    with drawing():
        plots = _plots(document)
        single, several = ([_figure(plot) for plot in plots if (len(plot.panels) > 1) is many] for many in (False, True))
    title = escape(words(document.get("title", "")) or "Reality gap")
    return PAGE.format(
        title=title,
        style=STYLE,
        kind=escape(effect_name(kind_of(document))),
        headline=escape(headline(document)),
        told="\n".join(f"<p>{_prose(line)}</p>" for line in _told(document)),
        causes=_cause_table(document["verdict"].get("causes") or ()),
        advice="\n".join(f"<h2>{heading}</h2>\n{_list('ul', items)}" for heading, items in _advice(document)),
        plots=f"<h2>Plots</h2>\n{_group('columns', single)}{_group('stack', several)}" if plots else "",
        data=_data(document),
        numbers=_embedded_json(document),
    )


def _told(document: Document) -> list[str]:
    summary = sentence(document["verdict"].get("summary") or "")
    said = [summary] if summary and summary != headline(document) else []
    return [*said, *cause_sentences(document), *evidence_sentences(document), *data_sentence(document)]


def _advice(document: Document) -> list[tuple[str, Sequence[Any]]]:
    verdict = document["verdict"]
    both = ((CANNOT_TELL, verdict.get("cannot_tell") or ()), (RECORD_NEXT, verdict.get("record_next") or ()))
    return [(heading, items) for heading, items in both if items]


def _plots(document: Document) -> list[Plot]:
    """What is in the document, in the order in which an argument goes: how large, what was weighed, what is left."""
    network = document.get("residual_network")
    return [
        *worst_window_plot(document.get("worst_window")),
        *ranking_plot(document.get("ranking")),
        *ladder_plot(document.get("ladder"), document["verdict"], network),
        *success_plot(document.get("success")),
        *horizon_plot(document.get("horizon")),
        *autocorrelation_plot(document.get("autocorrelation")),
        *confusability_plot(document.get("confusability")),
        *profile_plot(document.get("profiles")),
        *residual_plots(document.get("residuals")),
    ]


def _prose(text: str) -> str:
    return escape(text).replace(" %", "&nbsp;%")


def _group(name: str, figures: Sequence[str]) -> str:
    drawn = "\n".join(figures)
    return f'<div class="{name}">\n{drawn}\n</div>\n' if drawn else ""


def _figure(plot: Plot) -> str:
    wide = " wide" if len(plot.panels) > 1 else ""
    keys = "".join(f'<li><i class="key {key.mark}"></i>{escape(key.text)}</li>' for key in plot.legend)
    legend = f'<ul class="legend">{keys}</ul>' if keys else ""
    panels = "\n".join(
        f'<div class="panel"><h4>{escape(panel.heading)} <small>{escape(panel.note)}</small></h4>\n{panel.svg}</div>'
        for panel in plot.panels
    )
    numbered = _list("ol", plot.numbered) if plot.numbered else ""
    findings = "".join(f"<p>{escape(finding)}</p>" for finding in plot.findings)
    return (
        f'<figure class="plot{wide}">\n<h3>{escape(plot.title)}</h3>\n{legend}\n<div class="panels">{panels}</div>\n'
        f"{numbered}{findings}<figcaption>{_prose(plot.caption)}</figcaption>\n</figure>"
    )


def _cause_table(causes: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        (
            effect_name(cause["effect"]),
            words(cause["where"]),
            parameter_name(cause.get("parameter", "")),
            quantity_with_interval(cause.get("value"), words(cause.get("unit", "")), cause.get("interval_90")),
        )
        for cause in causes
    ]
    return _table(("cause", "where", "parameter", "value (90 % interval)"), rows) if rows else ""


def _data(document: Document) -> str:
    recordings = document.get("recordings") or ()
    provenance = document.get("provenance") or {}
    rows = [
        (words(one.get("name", "")), number(one.get("duration_s"), 4), count(one.get("samples")), words(one.get("used_for", "")))
        for one in recordings
    ]
    read = [(words(one.get("file", "")), words(one.get("sha256", ""))) for one in provenance.get("data") or ()]
    made = [
        f"Made {words(document['created'])}" if document.get("created") else "",
        f"by code version {words(provenance['code'])}" if provenance.get("code") else "",
    ]
    parts = [
        _folded(f"{count(len(rows))} recordings", _table(("recording", "duration / s", "samples", "used for"), rows))
        if rows
        else "",
        _folded(f"{count(len(read))} files with digests", _table(("file", "SHA-256"), read)) if read else "",
        f"<p>{escape(sentence(' '.join(part for part in made if part)))}</p>" if any(made) else "",
    ]
    return "\n".join(part for part in parts if part)


def _folded(summary: str, content: str) -> str:
    return f"<details><summary>{escape(summary)}</summary>\n{content}\n</details>"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    header = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "\n".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{header}</tr></thead>\n<tbody>{body}</tbody></table></div>'


def _list(tag: str, items: Sequence[Any]) -> str:
    close = words if tag == "ol" else sentence
    return f"<{tag}>" + "".join(f"<li>{escape(close(item))}</li>" for item in items) + f"</{tag}>\n"


def _embedded_json(document: Document) -> str:
    """The whole document as JSON that no parser of HTML can take for a tag; null for what is no number."""
    text = json.dumps(_plain(document), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if value is None or isinstance(value, bool | str):
        return value
    return int(value) if isinstance(value, int) else real(value)
