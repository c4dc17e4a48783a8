import shutil
import subprocess

import pytest

from kfit.cli.main import COMMANDS, TRAINING, main

TRY = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(( $# - 1 ))
_shtab_kfit "$1" "${COMP_WORDS[COMP_CWORD]}" 2>/dev/null
printf '%s\\n' "${COMPREPLY[@]}"
"""
BASH = shutil.which("bash")


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    path = tmp_path_factory.mktemp("completion") / "kfit.bash"
    with pytest.MonkeyPatch.context() as patch, path.open("w") as file:
        patch.setattr("sys.stdout", file)
        main(["completion", "bash"])
    return path


@pytest.mark.skipif(BASH is None, reason="needs bash")
def test_the_script_is_bash(script):
    subprocess.run([BASH, "-n", script], check=True)


@pytest.mark.skipif(BASH is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["kfit", ""], {*COMMANDS, *TRAINING}),
        (["kfit", "pos"], {"pose"}),
        (["kfit", "bench", "acc"], {"accuracy"}),
        (["kfit", "pose", "--int"], {"--intrinsics"}),
        (["kfit", "pose", "--category", "b"], {"bottle", "bowl"}),
        (["kfit", "pose", "pho"], {"photo.png", "photos"}),
        (["kfit", "pose", "photo.png", "--out", "pho"], {"photos"}),
        (["kfit", "fit", "-c", "photo."], {"photo.png"}),
        (["kfit", "evaluate", "--iou", "o"], {"oriented"}),
    ],
)
def test_bash_completes_commands_options_and_files(script, words, completed, tmp_path):
    (tmp_path / "photo.png").touch()
    (tmp_path / "photos").mkdir()
    done = subprocess.run([BASH, "-c", TRY, "try", script, *words], cwd=tmp_path, capture_output=True, text=True)
    found = {word.rstrip("/") for word in done.stdout.split()}
    assert {word for word in found if not word.startswith("-") or words[-1].startswith("-")} == completed


@pytest.mark.parametrize(("shell", "mark"), [("zsh", "#compdef kfit"), ("fish", "complete -c kfit")])
def test_other_shells_get_a_script_too(shell, mark, capsys):
    main(["completion", shell])
    out = capsys.readouterr().out
    assert mark in out
    assert all(name in out for name in COMMANDS)
