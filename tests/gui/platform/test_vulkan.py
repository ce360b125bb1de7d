import pytest

from tests.support.errors import refuses
from v3studio.gui.app import check_display
from v3studio.gui.platform.vulkan import vulkan_device


def test_missing_loader_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.util.find_library", lambda _: "libthere-is-no-such-loader.so.1")
    with refuses("gui.no_vulkan_loader", value="libthere-is-no-such-loader.so.1") as caught:
        vulkan_device()
    assert "apt-get install libvulkan1 mesa-vulkan-drivers" in str(caught.value)


def test_a_device_is_found_where_a_driver_is_installed() -> None:
    assert vulkan_device().endswith(("GPU)", "(other)", "(software)"))


def test_no_display_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with refuses("gui.no_display"):
        check_display()
