import sys
from pathlib import Path

import pytest

from tests.support.looping import wait_in_loop
from v3studio.gui.models.take.estimates import Estimates
from v3studio.pipelines.config import load_config
from v3studio.pipelines.config.presets import with_values
from v3studio.pipelines.events import Finished
from v3studio.pipelines.takes.take import Take

PRESETS = {
    "preview": {"seconds": 90.0, "stages": [{"stage": "train", "bytes": 5}, {"stage": "bake", "bytes": 1_250_000}]},
    "final": {"seconds": 7200.0, "stages": [{"stage": "bake", "bytes": None}]},
}
COMMAND = "v3studio.gui.models.take.jobs.v3studio_command"
PRINTED = Finished(outcome="done", seconds=1.0, result={"presets": PRESETS}).to_json()


def program(*lines: str) -> list[str]:
    return [sys.executable, "-c", "\n".join(lines)]


def test_figures_are_measured_once_and_kept(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    take = Take.open(finished / "take")
    config = load_config(take.config)
    runs = tmp_path / "runs"
    counting = f"import sys; open({str(runs)!r}, 'a').write(' '.join(sys.argv[1:]) + chr(10))"
    monkeypatch.setattr(COMMAND, lambda: program(counting, f"print({PRINTED!r})"))
    estimates = Estimates()
    estimates.show(take, config)
    assert estimates.words("preview") == "preview"
    estimates.start(take)
    estimates.start(take)  # it is running
    wait_in_loop("figures", lambda: not estimates.running)
    assert runs.read_text() == f"estimate {take.root} --presets --json\n"
    assert estimates.words("preview") == "preview: about 1 min 30 s, 1.2 MB"
    assert estimates.words("final") == "final: about 2 h 00 min"
    assert estimates.words("standard") == "standard"
    monkeypatch.setattr(COMMAND, lambda: pytest.fail("it must not run"))
    again = Estimates()
    assert again.show(take, config)
    assert again.figures == estimates.figures
    assert not again.show(take, config)
    assert not again.show(take, with_values(config, {"train.max_splats": 11})), "the presets set it"
    assert again.show(take, with_values(config, {"capture.scale": 0.5}))
    assert again.figures == {}, "of other images"
