"""What counts as which, and how answers are asked for and kept."""

import json
import sys

import pytest

from tests.second_generator import judging
from tests.second_generator.__main__ import main
from tests.second_generator.scoring import classify, score, text_of, values_of


def hidden(effect, *joints, value=0.3, declared=0.1, same=()):
    places = [{"where": joint, "parameters": {"torque_nm": value}, "declared": declared} for joint in joints or (None,)]
    return {"effect": effect, "law": effect, "same_physics": list(same), "places": places, "visibility": 9.0}


def truth(*causes, kind="single"):
    return {"kind": kind, "causes": list(causes), "session": {"joint_names": ["a", "b"]}}


def answer(verdict, *named, **more):
    causes = [{"effect": effect, "where": where, "parameter": "torque_nm"} for effect, where in named]
    return {"case": "x", "verdict": verdict, "causes": causes, "summary": "", "record_next": []} | more


COULOMB = hidden("coulomb_friction", "a")
TILT = hidden("table_tilt", same=["gravity"])
OUTSIDE = hidden("outside", "a")
NEXT = {"record_next": ["chirps"]}


@pytest.mark.parametrize(
    ("wanted", "causes", "said"),
    [
        ("right", [COULOMB], answer("named", ("coulomb_friction", "a"))),
        ("wrong_name", [COULOMB], answer("named", ("coulomb_friction", "b"))),
        ("wrong_name", [COULOMB], answer("named", ("coulomb_friction", "all joints"))),
        ("wrong_name", [COULOMB], answer("named", ("coulomb_friction", "a"), ("backlash", "a"))),
        ("wrong_name", [COULOMB], answer("named")),
        ("wrong_name", [], answer("named", ("coulomb_friction", "a"))),
        ("wrong_name", [OUTSIDE], answer("named", ("outside", "a"))),
        ("right", [hidden("action_delay", "a", "b")], answer("named", ("action_delay", "all joints"))),
        ("right", [hidden("action_delay", "a", "b")], answer("named", ("action_delay", "b"))),
        ("right", [TILT], answer("named", ("gravity", ""))),
        ("right", [TILT], answer("named", ("table_tilt", None))),
        ("right", [COULOMB, TILT], answer("named", ("coulomb_friction", "a"), ("table_tilt", ""))),
        ("partly", [COULOMB, TILT], answer("named", ("table_tilt", ""))),
        ("partly", [COULOMB, TILT], answer("confusable", ("table_tilt", ""), ("backlash", "a"), **NEXT)),
        ("right_set", [COULOMB], answer("confusable", ("coulomb_friction", "a"), ("backlash", "a"), **NEXT)),
        ("right_set", [COULOMB], answer("confusable", ("coulomb_friction", "all joints"), **NEXT)),
        ("other_set", [COULOMB], answer("confusable", ("coulomb_friction", "a"), ("backlash", "a"))),
        ("other_set", [COULOMB], answer("confusable", ("backlash", "a"), **NEXT)),
        ("other_set", [], answer("confusable", ("backlash", "a"), **NEXT)),
        ("misreading", [COULOMB], answer("unexplained", summary="positions of a count the other way round")),
        ("misreading", [], answer("nothing_wrong", more={"misreadings": ["degrees"]})),
        ("unexplained", [OUTSIDE], answer("unexplained")),
        ("nothing_wrong", [], answer("nothing_wrong")),
        ("not_identifiable", [COULOMB], answer("not_identifiable")),
        ("no_answer", [COULOMB], answer(None)),
    ],
)
def test_classes(wanted, causes, said):
    assert classify(truth(*causes), said) == wanted


def test_a_value_holds_together_with_what_was_declared():
    said = answer("named", ("coulomb_friction", "a"))
    for interval, holds in (([0.35, 0.45], True), ([0.25, 0.35], False)):
        said["causes"][0]["interval_90"] = interval
        assert values_of(truth(COULOMB), said) == [holds]


def test_counts_of_a_run():
    truths = {
        "one": truth(COULOMB),
        "two": truth(OUTSIDE, kind="outside"),
        "three": truth(kind="healthy"),
        "four": truth(COULOMB),
    }
    rows = [answer("named", ("coulomb_friction", "a")) | {"case": "one"}, answer("unexplained") | {"case": "two"}]
    rows += [answer("nothing_wrong") | {"case": "three"}, answer("named", ("backlash", "a")) | {"case": "three"}]
    counts = score(rows, truths)
    assert (counts["answered"], counts["made"], counts["wrong_names"], counts["false_alarms"]) == (3, 4, 1, 1)
    assert "right: single 1 of 1" in text_of(counts)
    assert "outside, called unexplained: 1 of 1" in text_of(counts)


TOOL = """
import json, pathlib, sys
place = pathlib.Path(sys.argv[3]).parent.name
if place == "robot-bad":
    sys.exit("torque: no such column")
if place == "robot-slow":
    import time
    time.sleep(600)
print(json.dumps({"verdict": "nothing_wrong", "causes": [], "summary": place, "files": ["x"], "new_key": 1}))
"""


@pytest.mark.parametrize(("method", "said"), [(None, []), ("rollouts", ["--method", "rollouts"])])
def test_the_tool_is_asked_by_its_own_method_unless_another_is_wanted(tmp_path, method, said):
    tool = tmp_path / "tool.py"
    tool.write_text("import json, sys\nprint(json.dumps({'verdict': 'nothing_wrong', 'causes': [], 'summary': sys.argv[6:]}))")
    answer = judging.ask(tmp_path / "robot-x", tmp_path / "answers", [sys.executable, str(tool)], 60.0, method)
    assert answer["summary"] == ["--json", *said]
    assert 0.0 <= answer["cpu_s"] < 60.0


def test_each_case_is_asked_until_it_has_an_answer(tmp_path):
    tool = tmp_path / "tool.py"
    tool.write_text(TOOL)
    (tmp_path / "truth").mkdir()
    out, asked = tmp_path / "results.jsonl", []
    for names, limit_s in ((("robot-bad", "robot-good"), 120.0), (("robot-slow", "robot-half-made"), 1.0), ((), 1.0)):
        for name in names:
            (tmp_path / "cases" / name).mkdir(parents=True)
            if name != "robot-half-made":
                (tmp_path / "truth" / f"{name}.json").write_text(json.dumps(truth(COULOMB)))
        judging.judge(tmp_path, out, [sys.executable, str(tool)], limit_s=limit_s, say=asked.append)
    rows = [json.loads(line) for line in out.read_text().splitlines()]
    # one that failed and one that was stopped are asked again
    assert [row["case"] for row in rows] == ["robot-bad", "robot-good", *["robot-bad", "robot-slow"] * 2]
    good = rows[1]
    assert (good["verdict"], good["summary"], good["exit_code"]) == ("nothing_wrong", "robot-good", 0)
    assert good["more"] == {"new_key": 1}
    assert rows[0]["stderr"] == ["torque: no such column"]
    assert "stopped after 1 s" in rows[3]["stderr"][-1]
    assert main(["score", str(out), str(tmp_path / "truth")]) == 0
