import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest

from tests.support.shared import made_once
from tests.support.warm_python import lose_locks
from v3studio.studio.process import passive_openmp

passive_openmp()  # before torch is imported; not here, since pytest-xdist's own process does without

if TYPE_CHECKING:
    from tests.support.object_store import ObjectStore


@pytest.fixture(autouse=True, scope="session")
def _few_threads() -> None:
    """Two threads, as on the smallest machine that is supported."""
    import torch

    torch.set_num_threads(2)


def pytest_configure(config: pytest.Config) -> None:
    """Register markers; `pytest_collection_modifyitems` applies them."""
    # Shells start background commands with Ctrl-C ignored, which programs that the tests start would inherit.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    hypothesis.settings.register_profile("any machine", deadline=None)
    hypothesis.settings.load_profile("any machine")
    if "V3STUDIO_WITHOUT_LOCKS" in os.environ:
        lose_locks()
    for line in (
        "gpu: needs a CUDA device; skipped if there is none",
        "long: one of its tests takes longer than most files; these files start first, so that none is left at the end",
        "slow: takes more than a few seconds: runs of the pipeline, training, windows, browsers, COLMAP",
        "window: drives the real window on a private X server",
        "colmap: runs structure from motion with COLMAP",
    ):
        config.addinivalue_line("markers", line)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Modules and tests stay to the end: looking for garbage among them would take a quarter of the collection."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


WINDOW_FIXTURES = {"window", "open_window", "display", "x_server"}
SLOW_FIXTURES = {"finished", "project", "long_footage", "browser"}
COLMAP_FOLDER = Path("tests/studio/calibration/sfm")
WINDOW_TIMEOUT = 600
"""Seconds; other tests have the timeout in pyproject.toml."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark tests by their fixtures and folder, and put the files that take long first."""
    import torch

    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        if fixtures & WINDOW_FIXTURES:
            item.add_marker("window")
            item.add_marker("slow")
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(WINDOW_TIMEOUT))
        if fixtures & SLOW_FIXTURES:
            item.add_marker("slow")
        if item.path.is_relative_to(config.rootpath / COLMAP_FOLDER):
            item.add_marker("colmap")
            item.add_marker("slow")
        if item.get_closest_marker("gpu") and not torch.cuda.is_available():
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))
    longest = {item.path for item in items if item.get_closest_marker("long")}
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in longest, item.path not in slow))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> object:
    """In CI a window test that would be skipped fails: an X server is missing there only by mistake."""
    report = yield
    if os.environ.get("CI") == "true" and report.skipped and item.get_closest_marker("window"):
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {report.longrepr}"
    return report


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with the finished take `take/`, made without interruption. Copy it before changing it."""
    from tests.support.tiny_capture import v3studio, write_project

    def make(folder: Path) -> None:
        write_project(folder)
        v3studio("run", folder / "ball.yaml", "--take", folder / "take").ok()

    return made_once(tmp_path_factory, "finished", make)


@pytest.fixture(scope="session")
def s3_server() -> "Iterator[ObjectStore]":
    """An S3 server, started for the first test that needs one."""
    from tests.support.object_store import object_store

    with object_store() as server:
        yield server


@pytest.fixture
def object_store(s3_server: "ObjectStore", tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> "Iterator[ObjectStore]":
    """The server with an empty bucket, and the environment to use it, with a cache in the test's folder."""
    import s3fs

    for name, value in s3_server.environment(tmp_path / "cache").items():
        monkeypatch.setenv(name, value)
    s3fs.S3FileSystem.clear_instance_cache()
    s3_server.reset()
    yield s3_server
    s3fs.S3FileSystem.clear_instance_cache()
