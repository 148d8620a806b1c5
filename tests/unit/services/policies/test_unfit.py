import re
from pathlib import Path

from api_schemas.policy import LAYOUTS
from services.policies.unfit import UnfitError, printable, problem_of, refused, wrong_input


def test_both_lists_stand_side_by_side_with_the_nearest_layout():
    said = problem_of(wrong_input(LAYOUTS["pose"], 54), "push.zip")
    assert said["slug"] == "observation-does-not-fit"
    rows = [line.split(" | ") for line in said["detail"].splitlines() if " | " in line]
    assert [rows[0][0].strip(), rows[0][1]] == ["the manifest", "layout rrc2022-push"]
    assert [rows[3][0].strip(), rows[3][1]] == ["18-20 cube_position_world_m 3", "18-41 cube_keypoints_world_m 24"]
    assert "the network takes 54" in said["detail"]
    assert "the layout rrc2022-push fits" in said["instead"]


def test_without_a_layout_that_fits_the_fields_are_listed():
    instead = wrong_input(LAYOUTS["pose"], 43).instead
    assert "fits" not in instead
    assert "tracker_delay_s 1" in instead


def test_a_problem_names_file_part_and_remedy():
    error = refused(UnfitError("it is bad", part="entry a", instead="send another", slug="s"), "p.zip")
    assert (error.status, error.slug) == (422, "s")
    assert error.detail == "p.zip, entry a: it is bad; send another."
    assert error.members == {"file": "p.zip", "part": "entry a", "instead": "send another"}


def test_names_are_printed_short_and_without_control_characters_and_quoted_for_a_shell():
    assert printable("a\n\x1b[31mb") == "a??[31mb"
    assert len(printable("n" * 5000)) == 101
    assert printable(None) == "FILE"
    assert "`trifarm pack 'a; rm -r b.pt'`" in problem_of(UnfitError("it is bad", pack=True), "a; rm -r b.pt")["detail"]


def test_every_problem_of_an_upload_is_documented():
    root = Path(__file__).resolve().parents[4]
    page = (root / "docs/problems.md").read_text()
    sources = [*(root / "services/policies").glob("*.py"), root / "services/api/policies.py"]
    text = "\n".join(path.read_text() for path in sources)
    slugs = set(re.findall(r'slug(?:: str)? ?= ?"([a-z0-9-]+)"', text)) | set(
        re.findall(r'(?:Refused|TooLarge)\(\s*"([a-z-]+)"', text)
    )
    assert len(slugs) > 20
    assert {slug for slug in slugs if f"`/problems/{slug}`" not in page} == set()
