#!/usr/bin/env bash
# Installs the system packages that are missing, or names them in one sentence.
#   scripts/system_packages.sh          what building and running needs
#   scripts/system_packages.sh --tests  the same, and what the window's tests need
# It looks for the thing itself (a library, a program, a header), so it also passes on
# systems other than Debian and Ubuntu where the thing has come from elsewhere.
set -euo pipefail
cd "$(dirname "$0")/.."

missing=()
need() { # need PACKAGE CHECK...: the package, and a command that succeeds where it is not needed
    local package=$1
    shift
    "$@" >/dev/null 2>&1 || missing+=("$package")
}
library() { grep -qF "$1" <<<"$libraries"; }
program() { command -v "$1"; }
compiler() { command -v g++ || command -v clang++; }
vulkan_driver() { compgen -G '/usr/share/vulkan/icd.d/*.json' || compgen -G '/etc/vulkan/icd.d/*.json'; }
headers() { "$python" -c 'import os, sysconfig; assert os.path.exists(sysconfig.get_path("include") + "/Python.h")'; }
can_make_venv() { [ -x .venv/bin/python ] || "$python" -c 'import ensurepip, venv'; }

libraries=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null || true)
python=$(scripts/find_python.sh)
version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')

need "python$version-venv" can_make_venv
need "python$version-dev" headers # Python.h, for the compiled rasterizer
need g++ compiler
need libgomp1 library libgomp.so.1
need libusb-1.0-0 library libusb-1.0.so.0 # from here on: what importing open3d loads
need libegl1 library libEGL.so.1
need libgl1 library libGL.so.1
need libx11-6 library libX11.so.6
need libvulkan1 library libvulkan.so.1 # from here on: what the window draws with
need mesa-vulkan-drivers vulkan_driver
if [ "${1:-}" = --tests ]; then
    need xvfb program Xvfb
    need xauth program xauth
    need xdotool program xdotool
    need imagemagick program import
    need chromium program chromium # the browser player's tests
fi
[ ${#missing[@]} -eq 0 ] && exit 0

if ! command -v apt-get >/dev/null; then
    echo "V3 Studio needs what Debian calls ${missing[*]}; install the like with this system's package manager." >&2
    exit 1
fi
if [ "$(id -u)" -eq 0 ]; then
    as_root=(env)
elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    as_root=(sudo -n env)
else
    echo "System packages are missing; install them with: sudo apt-get install ${missing[*]}" >&2
    exit 1
fi
echo "Installing system packages: ${missing[*]}"
"${as_root[@]}" DEBIAN_FRONTEND=noninteractive apt-get update -qq </dev/null
"${as_root[@]}" DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" </dev/null >/dev/null
