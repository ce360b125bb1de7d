#!/usr/bin/env bash
# Installs missing system packages, or prints the command that installs them.
#   scripts/system_packages.sh          packages needed to build and run
#   scripts/system_packages.sh --tests  additionally those needed by the tests of the window and the browser player
# It checks for the libraries, programs and headers themselves rather than for packages, so it also passes on
# systems other than Debian and Ubuntu that provide them in another way.
set -euo pipefail
cd "$(dirname "$0")/.."

missing=()
need() { # need PACKAGE CHECK...: the package, and a command that succeeds if it is not needed
    local package=$1
    shift
    "$@" >/dev/null 2>&1 || missing+=("$package")
}
library() { grep -qF "$1" <<<"$libraries"; }
program() { command -v "$1"; }
compiler() { command -v g++ || command -v clang++; }
vulkan_driver() { compgen -G '/usr/share/vulkan/icd.d/*.json' || compgen -G '/etc/vulkan/icd.d/*.json'; }
headers() { "$python" -c 'import os, sysconfig; assert os.path.exists(sysconfig.get_path("include") + "/Python.h")'; }
can_make_venv() { "$python" -c 'import ensurepip, venv' || .venv/bin/python -m pip --version; }

libraries=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null || true)
python=$(scripts/find_python.sh)
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')

need "python$version-venv" can_make_venv
need "python$version-dev" headers # Python.h, for the compiled rasterizer
need g++ compiler
need libgomp1 library libgomp.so.1
need libusb-1.0-0 library libusb-1.0.so.0 # from here on: loaded by `import open3d`
need libudev1 library libudev.so.1
need libegl1 library libEGL.so.1
need libgl1 library libGL.so.1
need libx11-6 library libX11.so.6
need libopengl0 library libOpenGL.so.0 # from here on: loaded by PyMeshLab's filters, which are missing without them
need libgmp10 library libgmp.so.10
need libcom-err2 library libcom_err.so.2
need libp11-kit0 library libp11-kit.so.0
need zlib1g library libz.so.1 # from here on: loaded by many Python packages
need libstdc++6 library libstdc++.so.6
need libgcc-s1 library libgcc_s.so.1
need libvulkan1 library libvulkan.so.1 # from here on: used by the window for rendering
need mesa-vulkan-drivers vulkan_driver
need libportaudio2 library libportaudio.so.2 # plays sound in the window
if [ "${1:-}" = --tests ]; then
    need xvfb program Xvfb
    need xauth program xauth
    need xdotool program xdotool
    need chromium program chromium # the browser player's tests
fi
[ ${#missing[@]} -eq 0 ] && exit 0

if ! command -v apt-get >/dev/null; then
    echo "V3 Studio needs these Debian packages: ${missing[*]}; install the equivalents with this system's package manager." >&2
    exit 1
fi
if [ "$(id -u)" -eq 0 ]; then
    as_root=(env)
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    as_root=(sudo -n env)
else
    echo "System packages are missing. Install them with this command, then run make again:" >&2
    install="apt-get install -y --no-install-recommends ${missing[*]}"
    if command -v sudo >/dev/null; then
        echo "  sudo apt-get update && sudo $install" >&2
    else
        echo "  su -c 'apt-get update && $install'" >&2
    fi
    exit 1
fi
log=$(mktemp)
trap 'rm -f "$log"' EXIT
apt() { # messages go to the log; two short attempts, since apt's default timeout is two minutes per server
    "${as_root[@]}" DEBIAN_FRONTEND=noninteractive LC_ALL=C apt-get -o Acquire::Retries=1 -o Acquire::http::Timeout=10 \
        -o Acquire::https::Timeout=10 -o DPkg::Lock::Timeout=120 "$@" </dev/null >>"$log" 2>&1
}
echo "Installing system packages: ${missing[*]}"
# A package list that cannot be fetched does not matter as long as the packages can be.
apt update || true
if ! apt install -y --no-install-recommends "${missing[@]}"; then
    if grep -qE 'Could not (resolve|connect)|Temporary failure|Cannot initiate|timed out' "$log"; then
        echo "The package servers of apt-get cannot be reached; connect this machine to the network and run make again." >&2
    else
        echo "apt-get could not install ${missing[*]}: $(grep -m1 '^E:' "$log" || tail -n1 "$log")" >&2
    fi
    exit 1
fi
