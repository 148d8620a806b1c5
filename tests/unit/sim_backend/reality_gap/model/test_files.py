"""What a study writes of the extended model can be loaded from where it was written."""

import mujoco
import pytest

from sim_backend.reality_gap.model.files import write_models
from sim_backend.reality_gap.verdict import Cause, Verdict, VerdictKind

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
ARM = (
    '<mujoco>{}<asset><mesh name="link" file="{}"/></asset><worldbody><body><joint name="elbow" axis="0 1 0"/>'
    '<geom type="mesh" mesh="link"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize(("compiler", "file"), [("", "parts/link.obj"), ('<compiler meshdir="parts"/>', "link.obj")])
def test_meshes_are_found_from_another_folder(tmp_path, compiler, file):
    parts, out = tmp_path / "robot" / "parts", tmp_path / "out"
    parts.mkdir(parents=True)
    out.mkdir()
    (parts / "link.obj").write_text(TETRAHEDRON)
    model = parts.parent / "robot.xml"
    model.write_text(ARM.format(compiler, file))
    friction = Cause("coulomb_friction", "torque_nm", "elbow", 0.2, "N m", (0.1, 0.3))
    verdict = Verdict(verdict=VerdictKind.NAMED, summary="friction", causes=(friction,))
    (written,) = write_models(verdict, "made", [], out, model=model)
    extended = mujoco.MjModel.from_xml_path(str(written))
    assert extended.dof_frictionloss.tolist() == [0.2]
    assert extended.nmeshvert == mujoco.MjModel.from_xml_path(str(model)).nmeshvert
