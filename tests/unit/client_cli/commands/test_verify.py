"""Signed reports: a true one is accepted, of a forged one the changed part is named, a foreign key is called unverified."""

import json
import re

import pytest

from api_schemas.signature import Signature
from client_cli.commands.verify import check
from client_cli.connection.farm_keys import KEYS_FILE, keep_key, known_keys
from client_cli.terminal.errors import ClientError, UsageProblem
from client_cli.terminal.exit_codes import ExitCode
from report_views.page import MAKER, MAKERS, render_page
from report_views.text import render
from services.jobs.reports import sign
from services.signing import KEY_FILE, FarmKey
from tests.unit.report_views.test_text import report, trial

HOSTILE = "</script><script>alert(1)</script>\"'&<b>"


@pytest.fixture
def key(tmp_path):
    return FarmKey.of(tmp_path)


@pytest.fixture
def page(key):
    body = report(*(trial(number) for number in range(3)), name=HOSTILE)
    return render_page(body, sign(body.model_dump(mode="json"), key))


def known(key):
    return frozenset({key.public_hex})


def test_a_true_report_is_accepted(page, key):
    found = check(page, known(key))
    assert (found.verdict, found.changed, found.exit_code) == ("true", (), ExitCode.OK)


def test_an_unknown_key_is_called_unverified(page):
    assert check(page, frozenset()).exit_code == ExitCode.UNVERIFIED


@pytest.mark.parametrize(
    "old, new, named",
    [
        ('"success_rate":0.9', '"success_rate":1.0', "success_rate"),
        ('"seed":9223372036854775807,"trial":1,', '"seed":1,"trial":1,', "per_trial[1]"),
        ('"policy":"ffff', '"policy":"eeee', "policy"),
        ('<p class="number">90 %</p>', '<p class="number">100 %</p>', "what the page shows under 'result'"),
        ("<dt>intervals</dt>", "<dt>guesses</dt>", "what the page shows under 'methods'"),
        ("</main>", "<p>winner of all</p></main>", "what the page holds besides its sections"),
        (MAKER, "trifarm report page 9", "the page's maker"),
    ],
)
def test_the_changed_part_is_named(page, key, old, new, named):
    assert old in page
    found = check(page.replace(old, new, 1), known(key))
    assert found.exit_code == ExitCode.DIFFERS
    assert any(part.startswith(named) for part in found.changed), found.changed


def test_a_report_signed_anew_by_another_is_not_the_farms(page, key, tmp_path):
    (tmp_path / "forger").mkdir()
    forger = FarmKey.of(tmp_path / "forger")
    body = report(trial(0), name="better").model_copy(update={"success_rate": 1.0})
    forged = render_page(body, sign(body.model_dump(mode="json"), forger))
    assert check(forged, known(key)).verdict == "unverified"
    claimed = re.sub(forger.public_hex, key.public_hex, forged)
    assert "the signature itself" in check(claimed, known(key)).changed


def test_a_trial_that_was_taken_away_is_named(key):
    body = report(*(trial(number) for number in range(3)))
    signature = sign(body.model_dump(mode="json"), key)
    shorter = body.model_copy(update={"per_trial": body.per_trial[:2]})
    assert "per_trial[2]" in check(render_page(shorter, signature), known(key)).changed


def test_logs_are_compared_with_what_was_signed(page, key, tmp_path):
    (tmp_path / "trial-000.mcap").write_bytes(b"another log")
    found = check(page, known(key), tmp_path)
    assert found.changed == ("trial-000.mcap is not the log that was signed",)
    assert found.missing == ("trial-001.mcap", "trial-002.mcap")
    assert found.verdict == "forged"


def test_logs_that_are_only_missing_are_no_forgery(trifarm, page, key, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(page)
    ended = trifarm("verify", str(file), "--key", key.public_hex, "--logs", str(tmp_path))
    assert ended.code == ExitCode.LOGS_MISSING
    assert "FORGED" not in ended.out
    assert "3 logs (trial-000.mcap, trial-001.mcap, trial-002.mcap)" in ended.out
    ended = trifarm("verify", str(file), "--logs", str(tmp_path), "--json")
    assert (ended.code, ended.document["verdict"], len(ended.document["missing"])) == (ExitCode.UNVERIFIED, "unverified", 3)


def test_an_absent_folder_of_logs_is_wrong_usage(trifarm, page, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(page)
    ended = trifarm("verify", str(file), "--logs", str(tmp_path / "absent"))
    assert ended.code == ExitCode.USAGE
    assert "absent" in ended.err


def test_what_is_no_report_is_refused():
    with pytest.raises(UsageProblem, match="no signed report"):
        check("<html></html>", frozenset())


@pytest.mark.parametrize("maker", MAKERS)
def test_a_page_of_every_maker_is_verified_and_its_forgery_is_found(maker, key):
    body = report(*(trial(number) for number in range(3)))
    page = render_page(body, sign(body.model_dump(mode="json"), key), maker)
    assert not check(page, known(key)).changed
    forged = page.replace("counted as failures", "not counted")
    assert forged != page
    assert check(forged, known(key)).changed


def test_names_are_only_text_in_the_page(page):
    assert "<script>alert" not in page
    assert page.count("<script") == 1
    data = json.loads(re.search(r'id="trifarm-signed-report">(.*?)</script>', page, re.DOTALL)[1])
    assert data["report"]["policy_name"] == HOSTILE


def test_the_key_is_private_and_lasts(tmp_path):
    first = FarmKey.of(tmp_path)
    assert (tmp_path / KEY_FILE).stat().st_mode & 0o777 == 0o600
    assert FarmKey.of(tmp_path) == first
    assert [path.name for path in tmp_path.iterdir()] == [KEY_FILE]
    (tmp_path / KEY_FILE).write_text("ab")
    with pytest.raises(ValueError, match="32"):
        FarmKey.of(tmp_path)
    assert FarmKey.of(tmp_path / "elsewhere", first.seed.hex()) == first
    with pytest.raises(ValueError, match="TRIFARM_FARM_KEY"):
        FarmKey.of(tmp_path / "elsewhere", "no key")


def test_signatures_are_the_same_at_every_time(key):
    body = report(trial(0)).model_dump(mode="json")
    assert sign(body, key) == sign(json.loads(json.dumps(body)), key)
    assert Signature.model_validate(sign(body, key).model_dump()) == sign(body, key)


def test_a_farms_key_is_kept_and_must_not_change(tmp_path):
    keep_key(tmp_path, "http://farm", "a" * 64)
    keep_key(tmp_path, "http://farm", "a" * 64)
    assert known_keys(tmp_path) == {"a" * 64: "the key of http://farm"}
    with pytest.raises(ClientError, match="another farm"):
        keep_key(tmp_path, "http://farm", "b" * 64)
    (tmp_path / KEYS_FILE).write_text("[]")
    with pytest.raises(UsageProblem, match="repair or delete"):
        known_keys(tmp_path)


def test_the_command_says_what_was_found(trifarm, page, key, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(page)
    assert trifarm("verify", str(file)).code == ExitCode.UNVERIFIED
    ended = trifarm("verify", str(file), "--key", key.public_hex)
    assert (ended.code, "true" in ended.out) == (0, True)
    file.write_text(page.replace('"successes":1,"task"', '"successes":3,"task"'))
    ended = trifarm("verify", str(file), "--key", key.public_hex, "--json")
    assert ended.code == ExitCode.DIFFERS
    assert ended.document["changed"][0] == "successes"
    assert trifarm("verify", str(file), "--key", "nonsense").code == ExitCode.USAGE


def test_the_print_has_a_page_of_figures_and_every_trial(key, tmp_path):
    from client_cli.views.report_pdf import LINES_ON_A_PAGE, write_pdf

    body = report(*(trial(number, name="$robot_1$") for number in range(90)), name="$x^2$ " + HOSTILE)
    write_pdf(body, sign(body.model_dump(mode="json"), key), tmp_path / "report.pdf")
    content = (tmp_path / "report.pdf").read_bytes()
    assert content.startswith(b"%PDF")
    assert len(re.findall(rb"/Type /Page\b", content)) == 1 + -(-(len(render(body).splitlines())) // LINES_ON_A_PAGE) == 3
