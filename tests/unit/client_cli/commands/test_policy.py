D = "0" * 64


def test_a_policy_is_deleted_by_its_digest(farm, trifarm):
    assert trifarm("policy", "delete", D).out == f"policy {D} is deleted\n"
    assert trifarm("policy", "delete", D, "--json").document == {"digest": D, "deleted": True}
    assert farm.commands == [f"delete {D}"] * 2


def test_what_is_no_digest_is_not_sent(farm, trifarm):
    assert trifarm("policy", "delete", "../jobs").code == 2
    assert not farm.commands
