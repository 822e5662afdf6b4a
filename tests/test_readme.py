"""The README keeps its word: its Python example runs, and its first screen holds two commands."""

import re
from pathlib import Path

import pytest

README = (Path(__file__).resolve().parents[1] / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


def test_python_example_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks("python")[0], "README.md", "exec"), {})
    minimum, above_half = map(float, capsys.readouterr().out.split())
    assert minimum > 0 and above_half > 0.88
    assert {path.name for path in tmp_path.iterdir()} == {"femur.vtu", "femur.png"}


def test_first_screen_has_two_commands() -> None:
    first_screen = README.partition("\n## ")[0]
    assert len(first_screen.splitlines()) < 24
    commands = re.findall(r"```bash\n(.*?)```", first_screen, re.S)
    assert len(commands) == 2
    assert all(len(command.strip().splitlines()) == 1 and "python3 -m venv" in command for command in commands)
    assert "gpubspline demo" in commands[0] and "pytest" in commands[1]


def test_every_command_of_the_readme_exists() -> None:
    from gpubspline.cli.entry import app

    known = {command.name or command.callback.__name__ for command in app.registered_commands if command.callback}
    used = set(re.findall(r"^gpubspline (\w+)", "\n".join(blocks("bash")), re.M))
    assert used and used <= known
