import pytest

JOB = "jabcdefghijkl"


def test_a_link_stands_alone_on_stdout(farm, trifarm):
    said = trifarm("share", "create", JOB)
    assert (said.out, "share revoke s1" in said.err) == ("http://farm/shared/hush\n", True)
    made = trifarm("share", "create", f"{JOB}-007", "--at", "2.7", "--days", "30", "--json").document
    assert (made["trial_id"], made["at_s"]) == (f"{JOB}-007", 2.7)


def test_shares_are_listed_without_links_and_revoked(farm, trifarm):
    listed = trifarm("share", "list").out
    assert f"report of {JOB}" in listed and "open" in listed and "shared/" not in listed
    assert trifarm("share", "revoke", "s1", "--json").document == {"share_id": "s1", "revoked": True}
    assert farm.commands == ["revoke s1"]


@pytest.mark.parametrize("wrong", [("job",), (f"{JOB}-x",), (JOB, "--at", "1"), (JOB, "--days", "91")])
def test_what_cannot_be_shared_is_refused_here(farm, trifarm, wrong):
    assert trifarm("share", "create", *wrong).code == 2
