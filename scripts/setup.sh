#!/usr/bin/env bash
# Creates .venv and installs the pinned packages, and this package (editable), into it. Fast if nothing has changed.
#   scripts/setup.sh [dev] [docs]          adds what tests and linters, or the documentation, need
#   scripts/setup.sh --packages-only dev   leaves this package out, for the first layers of a Docker image
# A finished part leaves its digest in .venv/.done-PART. An interrupted installation leaves .venv/.unfinished: .venv is
# then created again, from pip's cache. docs/INSTALL.md says what is installed and why.
set -euo pipefail
cd "$(dirname "$0")/.."
CPU_INDEX=https://download.pytorch.org/whl/cpu # PyTorch's own index; PyPI has only the CUDA build for Linux
# Variables of the user's shell that would install to, or import from, another place.
unset PYTHONPATH PYTHONHOME PIP_TARGET PIP_PREFIX
export PIP_USER=0 PIP_DISABLE_PIP_VERSION_CHECK=1

fail() {
    echo "$*" >&2
    exit 1
}

exec 9<scripts
flock --nonblock 9 || { echo "Another setup of this folder is running; waiting for it."; flock 9; }
trap 'echo "Interrupted; run it again." >&2; exit 130' INT TERM

# Which build of PyTorch

has_nvidia_gpu() { # WSL has only nvidia-smi
    compgen -G '/dev/nvidia[0-9]*' || compgen -G '/proc/driver/nvidia/gpus/*' || nvidia-smi -L 2>/dev/null | grep 'GPU '
}
installed_build=$(cat .venv/.torch-build 2>/dev/null || true)
build=${V3STUDIO_TORCH:-$installed_build}
[ -n "$build" ] || build=$(has_nvidia_gpu >/dev/null && echo cuda || echo cpu)
case $build in cpu | cuda) ;; *) fail "V3STUDIO_TORCH is '$build'; it must be cpu or cuda, or unset to detect a GPU." ;; esac

# .venv

python=$(scripts/find_python.sh)
why_recreate() { # prints why .venv cannot be used; nothing if it can
    local version="import sys; print('%d.%d' % sys.version_info[:2], end='')" found
    [ "${installed_build:-$build}" = "$build" ] || { echo "it has the other build of PyTorch"; return; }
    [ ! -e .venv/.unfinished ] || { echo "its installation was interrupted"; return; }
    found=$(.venv/bin/python -c "$version" 2>/dev/null) || { echo "its Python does not run"; return; }
    .venv/bin/python -c 'import pip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
        { echo "its Python is older than 3.11 or has no pip"; return; }
    [ -z "${PYTHON:-}" ] || [ "$("$python" -c "$version")" = "$found" ] || { echo "PYTHON is another version"; return; }
    grep -qF "$PWD/.venv/bin/" .venv/bin/pip || echo "it was moved from another folder"
}
reason="" fresh=""
[ ! -e .venv ] || reason=$(why_recreate)
[ -z "$reason" ] || echo "Recreating .venv: $reason."
if [ ! -e .venv ] || [ -n "$reason" ]; then
    # If .venv is active, python3 is the one inside, which is about to be removed.
    base=$("$python" -c 'import sys; print(getattr(sys, "_base_executable", sys.executable))')
    rm -rf .venv
    "$base" -m venv .venv || fail "$base -m venv could not create $PWD/.venv; see the message above."
    fresh=yes
fi
pip=(.venv/bin/python -m pip)

# Parts

part() { # part NAME DIGEST COMMAND...: run the command unless it has been run for this digest
    local name=$1 digest=$2
    shift 2
    [ "$(cat ".venv/.done-$name" 2>/dev/null)" != "$digest" ] || return 0
    touch .venv/.unfinished
    "$@" || fail "The $name could not be installed; see the messages above. If the network failed, run it again."
    echo "$digest" >".venv/.done-$name"
    rm .venv/.unfinished
}
digest() { cat "$@" | sha256sum | cut -d' ' -f1; }
install() { # without bytecode, which would double the time; Python compiles what it imports
    "${pip[@]}" install --no-compile --retries 2 "$@"
}

version_of() { sed -nE "s/^$1==([^ ]+).*/\1/p" requirements.lock; }
install_torch() {
    local version others
    version=$(version_of torch)
    others=$(mktemp)
    { grep -oE '^[a-z0-9._-]+==[^ ;]+' requirements.lock || true; } >"$others"
    echo "Installing PyTorch $version ($build)"
    # The lock has no hash of the CPU build, which is on PyTorch's index, or where pip's configuration says.
    if [ "$build" = cuda ]; then
        install -c "$others" "torch===$version" # === excludes the local version +cpu
    elif ! install --no-deps --timeout 15 --extra-index-url "$CPU_INDEX" "torch==$version+cpu"; then
        echo "There is no CPU build of PyTorch $version at $CPU_INDEX; installing the one that pip finds elsewhere."
        install -c "$others" "torch==$version"
    fi
    rm "$others"
    echo "$build" >.venv/.torch-build
    echo "For the other build of PyTorch: V3STUDIO_TORCH=$([ "$build" = cpu ] && echo cuda || echo cpu) make setup"
}
# open3d and open3d-cpu have the same modules; the latter is smaller and exists for x86-64 only.
unwanted_open3d=open3d-cpu
if [ "$build" = cpu ] && [ "$(uname -m)" = x86_64 ]; then unwanted_open3d=open3d; fi
install_locked() { # install_locked LOCK: pip refuses files with other hashes
    local wanted status=0 have=""
    [ "$1" = requirements.lock ] || have=$(grep -oE '^[a-z0-9._-]+==[^ ;]+' requirements.lock)
    wanted=$(mktemp)
    awk -v skip="^(torch|$unwanted_open3d)==" -v have="$have" '
        BEGIN { split(have, names, "\n"); for (i in names) installed[names[i]] }
        /^[a-z0-9]/ { keep = $0 !~ skip && !($1 in installed) }
        keep' "$1" >"$wanted"
    if .venv/bin/python -c "import importlib.metadata as m; m.version('$unwanted_open3d')" 2>/dev/null; then
        "${pip[@]}" uninstall --yes open3d open3d-cpu # both, since they share their files
    fi
    echo "Installing the packages of $1"
    install --no-deps --require-hashes -r "$wanted" || status=$?
    rm "$wanted"
    return $status
}
install_package() {
    echo "Building and installing v3studio (editable)"
    PATH="$PWD/.venv/bin:$PATH" "${pip[@]}" install --quiet --no-build-isolation --no-deps --editable .
}
link_package() { # the sources under their installed names, for what reads them without importing: mypy, mkdocstrings, editors
    local package=build/package/v3studio
    rm -rf "$package" && mkdir -p "$package"
    ln -s ../../../{studio,pipelines,gui} "$package"
    find v3studio -maxdepth 1 -type f -exec ln -s ../../../{} "$package" ';'
}

package=yes sets=()
for word in "$@"; do
    case $word in
        --packages-only) package="" ;;
        dev | docs) sets+=("$word") ;;
        *) fail "setup.sh: unknown argument '$word'" ;;
    esac
done
part torch "$build $(version_of torch)" install_torch
part requirements "$build $(digest requirements.lock)" install_locked requirements.lock
for set in ${sets[@]+"${sets[@]}"}; do
    part "requirements-$set" "$build $(digest "requirements-$set.lock")" install_locked "requirements-$set.lock"
done
if [ -n "$package" ]; then
    sources=$(find studio/rasterizer -name '*.cpp' -o -name '*.h' | LC_ALL=C sort)
    # The editable installation lists all modules: a module that became a package is not found by the old list.
    modules=$(find studio pipelines gui v3studio -name '*.py' | LC_ALL=C sort)
    part package "$(digest pyproject.toml CMakeLists.txt $sources <(echo "$modules"))" install_package
    link_package
fi
[ -z "$fresh" ] || du -sm .venv | awk '{ print "Installed into .venv: " $1 " MB" }'
