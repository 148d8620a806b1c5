import json
import math
import warnings
from html.parser import HTMLParser

import matplotlib
import pytest

from sim_backend.reality_gap.report.report import CANNOT_TELL, RECORD_NEXT, html_page, summary_lines, write_html
from sim_backend.reality_gap.verdict import VerdictKind
from tests.unit.sim_backend.reality_gap.report import study_documents as documents

SECTIONS = {
    "worst_window": "Worst held-out window", "ranking": "Ranked held-out gains", "ladder": "Gain per added cause",
    "success": "Success: before, after, measured", "horizon": "Error against horizon",
    "autocorrelation": "Autocorrelation of the residual", "confusability": "Which causes look alike",
    "profiles": "Profile likelihoods", "residuals": "Residual against velocity",
}  # fmt: skip
VOID = {"meta", "br", "use"}


class Page(HTMLParser):
    """Elements, text and attributes of a page, and whether every element that is opened is closed in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.scripts: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)


def test_data_that_are_not_as_they_are_told_are_said_to_be_so_and_no_gain_is_shown_for_that():
    said = "the positions of elbow are in degrees, not in rad"
    document = documents.full_document()
    document["verdict"] |= documents.verdict("unexplained") | {
        "summary": f"The model agrees far better with the data if {said}.",
        "misreads": said, "follows": [said], "held_out": None, "runner_up": None, "null_p": None,
    }  # fmt: skip
    lines = summary_lines(document)
    assert lines[0].endswith(": The model does not agree with the data as they are told.")
    assert sum(said in line for line in lines) == 1
    assert not any("flexible network" in line or "follows" in line for line in lines)


@pytest.fixture(scope="module")
def full_page() -> str:
    return html_page(documents.full_document(joints=documents.JOINTS[:2]))


@pytest.fixture(scope="module")
def crowded_page() -> str:
    return html_page(documents.crowded_document(against=("position",)))


def test_the_summary_has_every_number_of_the_verdict_with_its_unit():
    text = "\n".join(summary_lines(documents.full_document()))
    for part in (
        "coulomb friction, finger120_joint_middle: 0.031 ± 0.004 N m (90 %)",
        "12\u202f480 samples): 4.13 → 1.21 mrad (−71 %, 95 % interval −66 to −75 %)",
        "noise floor 0.93 mrad, so that 91 % of the excess over it is gone",
        "Runner-up: stribeck friction, finger120_joint_middle, 7.3 nats",
        "speeds below 0.05 rad/s",
        "p = 0.002",
        "Success over 200 trials",
        "nominal model 92 % (80 %: 89 to 94)",
        "23 → 2 percentage points",
        "4 recordings of 60 s together, 60\u202f000 samples (3 fit; 1 held out)",
    ):
        assert part in text


def test_a_rival_that_gains_more_than_what_was_taken_is_ahead():
    document = documents.full_document()
    document["verdict"]["runner_up"]["behind"] = -10.6
    (said,) = (line for line in summary_lines(document) if line.startswith("Runner-up"))
    assert "11 nats ahead; what separates them" in said


@pytest.mark.parametrize("kind", [str(kind) for kind in VerdictKind])
def test_every_verdict_reads_as_sentences_and_becomes_a_page(kind):
    document = documents.small_document(kind)
    lines = summary_lines(document)
    page = Page(html_page(document))
    text = "".join(page.text).replace("\xa0", " ")
    assert lines[0].startswith("Robot 7, identification logs: ")
    assert {f"{CANNOT_TELL}:", f"{RECORD_NEXT}:"} <= set(lines)
    for line in lines:
        assert line.endswith((".", ":"))
        assert not any(raw in line for raw in ("None", "nan", "_nm", "unknown"))
        assert line.removeprefix("Robot 7, identification logs: ").removeprefix("  - ").rstrip(":") in text
    assert "svg" not in page.tags
    assert not page.open


def test_headlines_differ_by_verdict_and_by_the_number_of_causes():
    headlines = {summary_lines(documents.small_document(str(kind)))[0] for kind in VerdictKind}
    two = documents.small_document()
    two["verdict"]["causes"] = documents.verdict("confusable")["causes"]
    assert len(headlines) == len(VerdictKind)
    assert "name 2 things" in summary_lines(two)[0]


@pytest.mark.parametrize(
    ("kind", "said"),
    [("nothing_wrong", "What little differs follows: speed."), ("unexplained", "What is left of the error follows: speed.")],
)
def test_what_a_healthy_robot_differs_by_is_not_called_an_error(kind, said):
    document = documents.small_document(kind)
    document["verdict"]["follows"] = ["speed"]
    assert [line for line in summary_lines(document) if "follows" in line] == [said]


def test_parameters_of_one_effect_at_one_place_are_one_sentence():
    document = documents.small_document()
    document["verdict"]["causes"] = [
        documents.cause("stribeck_friction", "extra_torque_nm", "j", 0.02, "N m", [0.01, 0.03]),
        documents.cause("stribeck_friction", "speed_rad_s", "j", 0.05, "rad/s", [0.04, 0.06]),
    ]
    lines = [line for line in summary_lines(document) if line.startswith("Cause")]
    assert lines == ["Cause: stribeck friction, j: extra torque 0.020 ± 0.010 N m (90 %); speed 50 ± 10 mrad/s (90 %)."]


def test_axes_of_one_effect_are_one_thing_and_one_sentence():
    document = documents.small_document()
    document["verdict"]["causes"] = [
        documents.cause("tracking_offset", "position_m", axis, 0.001 * k, "m", [0.001 * k - 0.0005, 0.001 * k + 0.0005])
        for k, axis in enumerate("xyz", 1)
    ]
    assert "things" not in summary_lines(document)[0]
    lines = [line for line in summary_lines(document) if line.startswith("Cause")]
    assert len(lines) == 1
    assert "position x 1.0" in lines[0] and "position z 3.0" in lines[0]


def test_errors_where_a_cause_acts_stand_before_those_of_the_rest_in_readable_units():
    document = documents.small_document()
    there = documents.held_out(0.0112, 0.00153, 5e-5, (0.82, 0.9)) | {"metric": "off where the rotor of j hits", "unit": "rad"}
    document["verdict"] |= {"held_out": documents.held_out(1.0, 1.0, 0.9, (0.0, 0.0)), "held_out_there": [there]}
    lines = [line for line in summary_lines(document) if line.startswith("Held-out")]
    assert len(lines) == 2
    assert (
        "(off where the rotor of j hits, 12\u202f480 samples): 11.2 → 1.53 mrad (−86 %, 95 % interval −82 to −90 %)" in lines[0]
    )


def test_an_error_that_grew_is_not_called_a_reduction():
    document = documents.small_document()
    document["verdict"]["held_out"] = documents.held_out(1.0, 1.25, 0.9, (-0.4, -0.1))
    line = next(line for line in summary_lines(document) if line.startswith("Held-out"))
    assert "(+25 %, 95 % interval +40 to +10 %)" in line
    assert "excess" not in line


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_is_drawn_if_and_only_if_it_is_there(section, full_page):
    document = documents.small_document()
    document[section] = documents.full_document(documents.JOINTS[:1], ("velocity",))[section]
    page = Page(html_page(document))
    titles = [title for title in SECTIONS.values() if title in page.text]
    assert titles == [SECTIONS[section]]
    assert SECTIONS[section] in Page(full_page).text
    assert "svg" in page.tags


def test_residuals_have_a_plot_for_each_quantity_and_six_panels_at_most(full_page, crowded_page):
    page = Page(full_page)
    for against in documents.AGAINST:
        assert f"Residual against {against}" in page.text
        named = [value for name, value in page.attributes if name == "aria-label" and value.endswith(f"against {against}")]
        assert len(named) == 2
    shown = [value for name, value in Page(crowded_page).attributes if name == "aria-label" and value.startswith("Residual of")]
    assert len(shown) == 6
    assert "shoulder_4" in shown[0]


def test_text_of_the_drawings_is_text_and_colours_are_the_pages(full_page):
    page = Page(full_page)
    assert "velocity / rad/s" in page.text
    assert "stribeck friction, finger0_joint_middle" in page.text
    assert "var(--before)" in full_page
    assert "#00000" not in full_page
    assert "prefers-color-scheme: dark" in full_page


def test_every_caption_is_there_and_the_counts_are_with_it(full_page):
    page = Page(full_page)
    assert page.tags.count("figcaption") == page.tags.count("figure") == len(SECTIONS) + len(documents.AGAINST) - 1
    for note in ("240 held-out windows", "12 hypotheses, 5 above the line", "200 trials", "250 samples", "17 fits"):
        assert note in page.text


def test_the_same_document_gives_the_same_bytes(tmp_path):
    full = documents.full_document(documents.JOINTS[:1], ("heat",))
    document = documents.small_document() | {key: full[key] for key in ("residuals", "ranking", "worst_window")}
    for name in ("a.html", "b.html"):
        write_html(document, tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_the_page_is_whole_alone_and_without_repeated_ids(full_page, crowded_page):
    for text in (full_page, crowded_page):
        page = Page(text)
        ids = [value for name, value in page.attributes if name == "id"]
        assert not page.open
        assert len(ids) == len(set(ids))
        assert not {"link", "img", "iframe", "image"} & set(page.tags)
        links = [value for name, value in page.attributes if name in {"href", "src", "xlink:href"}]
        assert all(link.startswith("#") for link in links)
        assert {link[1:] for link in links} <= set(ids)
        assert "//" not in "".join(part for part in page.text if part not in page.scripts)
        assert "://" not in text
        assert not any(name.startswith("on") for name, _ in page.attributes)


def test_numbers_in_the_page_are_those_of_the_document():
    document = documents.full_document(documents.JOINTS[:1], ("heat",))
    document["verdict"]["null_p"] = math.nan
    (numbers,) = Page(html_page(document)).scripts
    document["verdict"]["null_p"] = None
    assert json.loads(numbers) == json.loads(json.dumps(document))


def test_hostile_names_are_only_text(full_page):
    document = documents.full_document((documents.HOSTILE, "$", "日本語 🤖"), ("torque",))
    document["title"] = document["verdict"]["summary"] = documents.HOSTILE
    document["verdict"]["causes"][0] |= {"effect": documents.HOSTILE, "where": documents.HOSTILE, "unit": documents.HOSTILE}
    document["verdict"]["cannot_tell"] = [documents.HOSTILE]
    document["residuals"]["unit"] = document["ranking"]["unit"] = document["worst_window"]["where"] = documents.HOSTILE
    document["recordings"][0] |= {"name": documents.HOSTILE, "used_for": documents.HOSTILE}
    text = html_page(document)
    page = Page(text)
    assert page.tags.count("script") == 1
    assert {"b", "alert"}.isdisjoint(page.tags)
    assert set(page.tags) <= set(Page(full_page).tags)
    assert not page.open
    assert not set(text) & {chr(code) for code in range(32) if chr(code) != "\n"}
    assert json.loads(page.scripts[0])["title"] == documents.HOSTILE
    assert not set("".join(summary_lines(document))) & {chr(code) for code in range(32)}


def test_crowded_studies_keep_their_rows_and_mark_what_is_missing(crowded_page):
    page = Page(crowded_page)
    text = "".join(page.text)
    assert "30 hypotheses, 5 above the line" in page.text
    assert "the 6 of 12 joints with the largest residual" in text
    assert "(3.2 ± 0.3) × 10⁸ N/m" in text
    assert "0.3 µrad (90\xa0%: 0.1 to 0.9)" in text
    assert "drift unknown" in text
    assert "flat: these data do not bound it here" in text
    assert "beyond the dashed line the axis is logarithmic" in text
    assert not any(word in "".join(part for part in page.text if part not in page.scripts) for word in ("nan", "inf "))


@pytest.mark.parametrize("bad", [-math.inf, 5e-324])
def test_no_number_breaks_the_page(bad):
    document = documents.full_document(documents.JOINTS[:1], ("time since reversal",))
    document = {"title": "t", "recordings": document["recordings"]} | {key: _filled(document[key], bad) for key in SECTIONS}
    document["verdict"] = {"verdict": "named"} | _filled({key: documents.verdict()[key] for key in ("causes", "held_out")}, bad)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = html_page(document)
        assert summary_lines(document)
    assert not Page(page).open
    assert "NaN" not in page


def test_settings_of_matplotlib_are_as_before():
    before = dict(matplotlib.rcParams)
    document = documents.small_document()
    html_page(document | {"success": documents.full_document()["success"]})
    assert dict(matplotlib.rcParams) == before


def _filled(value, number):
    """The same structure with every number replaced."""
    if isinstance(value, dict):
        return {key: _filled(part, number) for key, part in value.items()}
    if isinstance(value, list):
        return [_filled(part, number) for part in value]
    return number if isinstance(value, int | float) else value
