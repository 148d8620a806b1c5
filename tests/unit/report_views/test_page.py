"""Pages of reports: those of earlier makers stay as they were signed, byte for byte; newer ones suit a phone."""

import hashlib
from base64 import b64encode

import pytest

from api_schemas.signature import unsigned
from report_views.page import MAKER, render_page, style_source
from tests.unit.report_views.test_text import report, trial

SIGNED = {
    "trifarm report page 1": "1f27fd91b3dad84dee410117f5483170177478415be9ad6adb0c07998a9f0ebc",
    "trifarm report page 2": "11b6e931faa0e7954e715c21b4cb7d05086056729a908720b98ab93668639ab1",
    "trifarm report page 3": "e29c0f988434eb98753bb062c840a3f2f151a67105cdc36815ae8aee06ad0693",
}
"""SHA-256 of the page of one report, as each maker drew it while it was the newest, up to its signature and data."""


def page(maker):
    body = report(*(trial(number) for number in range(3)))
    signature = unsigned("0" * 64, body.model_dump(mode="json")).model_copy(update={"signature": "1" * 128})
    return render_page(body, signature, maker)


@pytest.mark.parametrize("maker", SIGNED)
def test_a_page_of_an_earlier_maker_is_drawn_as_it_was(maker):
    drawn, _, _ = page(maker).partition('<section id="signature">')
    assert hashlib.sha256(drawn.encode()).hexdigest() == SIGNED[maker]


def test_a_new_page_names_its_cells_for_a_phone_and_shows_the_limit():
    new = page(MAKER)
    assert '<td data-is="robot">' in new and '<td class="n" data-is="error mm">' in new
    assert 'class="limit"' in new and "the limit of 20 mm" in new


@pytest.mark.parametrize("maker", [*SIGNED, MAKER])
def test_the_policy_of_a_page_allows_its_own_style_alone(maker):
    shown = page(maker)
    style = shown.split("<style>")[1].split("</style>")[0]
    assert f"'sha256-{b64encode(hashlib.sha256(style.encode()).digest()).decode()}'" == style_source(maker)
    assert shown.count(style_source(maker)) == 1
