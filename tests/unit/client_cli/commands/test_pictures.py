"""Pictures and films with a small program in the renderer's place: what is passed on, and what is refused before it starts."""

import sys

import pytest


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "trial-007.mcap"
    path.write_bytes(b"the log")
    return path


@pytest.fixture
def rendering(monkeypatch, tmp_path):
    """Puts a program that notes its arguments in the renderer's place; it ends with the code that is given."""

    def use(code):
        program = (
            f"import sys; open({str(tmp_path / 'seen')!r}, 'w').write(' '.join(sys.argv[1:])); print('told'); sys.exit({code})"
        )
        command = lambda module, *rest: [sys.executable, "-c", program, module, *rest]  # noqa: E731
        monkeypatch.setattr("client_cli.commands.pictures.module_command", command)

    return use


def test_a_picture_is_asked_for_as_it_was_wanted(trifarm, log, tmp_path, rendering):
    rendering(0)
    out = tmp_path / "view.png"
    ended = trifarm("look", str(log), "--at", "2.7", "--out", str(out), "--edges")
    assert (ended.code, ended.out) == (0, "told\n")
    assert (tmp_path / "seen").read_text() == f"sim_backend.vision look {log} --out {out} --at 2.7 --edges"


def test_a_film_that_cannot_be_rendered_ends_as_the_renderer_does(trifarm, log, tmp_path, rendering):
    rendering(1)
    assert trifarm("video", str(log), "--out", str(tmp_path / "trial.mp4"), "--rate", "25", "--drawn").code == 1
    assert (tmp_path / "seen").read_text().endswith("trial.mp4 --rate 25.0 --drawn")


@pytest.mark.parametrize("command", ["look", "video"])
def test_what_is_not_there_is_refused_before_anything_starts(trifarm, log, tmp_path, command):
    assert "there is no file" in trifarm(command, str(tmp_path / "none.mcap")).err
    ended = trifarm(command, str(log), "--out", str(tmp_path / "nowhere" / "file.png"))
    assert ended.code == 2 and "there is no folder" in ended.err
