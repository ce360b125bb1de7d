"""Finds the Vulkan device through ctypes, before Open3D's GUI is used.

Open3D draws with Filament on Vulkan. Without a driver it ends the process with a native abort that Python cannot
catch. This module therefore loads the Vulkan loader, creates an instance and lists its devices (Vulkan 1.0
specification, sections 3.2, 4.1 and 5.1).
"""

import ctypes
import ctypes.util
import struct

from v3studio.studio.errors import StudioError

_KINDS = {2: "discrete GPU", 1: "integrated GPU", 3: "virtual GPU", 0: "other", 4: "software"}  # the best one first
_SUCCESS, _INCOMPLETE = 0, 5
_CREATE_INSTANCE = struct.pack("=I60x", 1)  # VkInstanceCreateInfo: sType; the other fields are zero
_PROPERTIES_BYTES = 4096  # VkPhysicalDeviceProperties takes 824 on 64-bit; the rest is a margin
_PROPERTIES = struct.Struct("=5I256s")  # its first fields; the last of these are deviceType and deviceName
_INSTALL = "On Debian and Ubuntu, run `sudo apt-get install {packages}`"


def vulkan_device() -> str:
    """Name of this machine's best Vulkan device, and its kind, of `_KINDS`, in parentheses. Raises StudioError:
    `gui.no_vulkan_loader`, `gui.no_vulkan_driver` or `gui.no_vulkan_device`; `fix` names the packages."""
    name = ctypes.util.find_library("vulkan") or "libvulkan.so.1"
    try:
        vulkan = ctypes.CDLL(name)
    except OSError:
        problem = f"the window needs Vulkan, and its loader {name} was not found"
        fix = f"{_INSTALL.format(packages='libvulkan1 mesa-vulkan-drivers')}."
        raise StudioError("gui.no_vulkan_loader", problem, value=name, fix=fix) from None
    fix = f"{_INSTALL.format(packages='mesa-vulkan-drivers')}, or install your graphics card's driver."
    instance = ctypes.c_void_p()
    status = vulkan.vkCreateInstance(_CREATE_INSTANCE, None, ctypes.byref(instance))
    if status != _SUCCESS:
        problem = f"the window needs Vulkan, and no driver was found (vkCreateInstance returned {status})"
        raise StudioError("gui.no_vulkan_driver", problem, value=status, fix=fix)
    try:
        devices = _devices(vulkan, instance)
    finally:
        vulkan.vkDestroyInstance(instance, None)
    if not devices:
        raise StudioError("gui.no_vulkan_device", "the window needs Vulkan, and no device was found", fix=fix)
    kind, name = min(devices, key=lambda device: list(_KINDS).index(device[0]))
    return f"{name} ({_KINDS[kind]})"


def _devices(vulkan: ctypes.CDLL, instance: ctypes.c_void_p) -> list[tuple[int, str]]:
    """Kinds and names."""
    count = ctypes.c_uint32(0)
    status = vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    if status not in (_SUCCESS, _INCOMPLETE) or count.value == 0:
        return []
    handles = (ctypes.c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles)
    devices = []
    for handle in handles[: count.value]:
        buffer = ctypes.create_string_buffer(_PROPERTIES_BYTES)
        vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), buffer)
        *_, kind, name = _PROPERTIES.unpack_from(buffer)
        devices.append((kind if kind in _KINDS else 0, name.split(b"\0")[0].decode(errors="replace")))
    return devices
