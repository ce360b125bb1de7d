#!/usr/bin/env bash
# Tests the setup on a freshly installed system: `make fresh-test` builds a minimal Debian with only git, make and
# python3, and in it clones HEAD, sets it up and processes two frames of the sample capture through all stages, twice:
# as root, and as a user without root or sudo, who must first be shown one command that installs what is missing.
#   FRESH_SUITE=trixie make fresh-test    another release (default: bookworm)
#   FRESH_DIR=/big/disk make fresh-test   folder to unpack in, with 8 GB free (default: /var/tmp)
#   FRESH_FULL=1 make fresh-test          `make demo` and `make test` in full instead of two frames (about an hour)
# Needs Linux, root, debootstrap (installed if missing) and a package mirror; skips itself where these are missing,
# except if CI is set. Each step runs in its own mount and PID namespace, which ends with it. pip's settings, and the
# local folders and files that they name, are available inside. Downloads are cached in ~/.cache/v3studio/fresh.
set -euo pipefail
cd "$(dirname "$0")/.."
suite=${FRESH_SUITE:-bookworm}
cache=${XDG_CACHE_HOME:-$HOME/.cache}/v3studio/fresh
say() { echo "fresh-test: $*"; }
cannot() {
    say "CANNOT RUN: $*" >&2
    [ -n "${CI:-}" ] && exit 1
    say "SKIPPED"
    exit 0
}

[ "$(uname)" = Linux ] && [ "$(id -u)" = 0 ] || cannot "it needs Linux and root"
command -v debootstrap >/dev/null || { apt-get update -qq && apt-get install -y -qq debootstrap; } >/dev/null 2>&1 ||
    cannot "debootstrap cannot be installed"
mkdir -p "$cache/apt-$suite" "$cache/pip"
work=$(mktemp -d "${FRESH_DIR:-/var/tmp}/v3studio-fresh-XXXXXX")
chmod 755 "$work"
exec 9>"$cache/lock"
flock --nonblock 9 || { say "waiting for another run"; flock 9; }
cleanup() { # mounts exist in the namespaces only; never delete through one that was left
    if grep -q " $work/" /proc/self/mountinfo; then say "$work has mounts; delete it by hand"; else
        rm -rf --one-file-system "$work"
    fi
}
trap cleanup EXIT
[ "$(df --output=avail -BG "$work" | tail -n1 | tr -dc 0-9)" -ge 8 ] || cannot "$work has less than 8 GB free; set FRESH_DIR"
namespace() { unshare --mount --pid --fork --kill-child "$@"; }

# The minimal system, rebuilt after two weeks

base=$cache/$suite-$(uname -m).tar
if [ -z "$(find "$base" -mtime -14 2>/dev/null)" ]; then
    mirror=$(apt-get indextargets --format '$(REPO_URI) $(ORIGIN)' 'Created-By: Packages' | awk '/ (Debian|Ubuntu)$/ { print $1; exit }')
    mirror=${FRESH_MIRROR:-${mirror:-http://deb.debian.org/debian}}
    say "building a minimal $suite from $mirror"
    namespace debootstrap --variant=minbase --include=git,make,python3 "$suite" "$work/base" "$mirror" \
        >"$work/debootstrap.log" 2>&1 || cannot "debootstrap failed: $(tail -n3 "$work/debootstrap.log" | tr '\n' ' ')"
    tar -C "$work/base" --numeric-owner --exclude='./dev/*' --exclude='./var/cache/apt/archives/*.deb' -cf "$base.new" .
    mv "$base.new" "$base"
    rm -rf --one-file-system "$work/base"
fi

# What downloads need: pip's settings as variables, and the local folders and files that they name

variables=$(
    { .venv/bin/python -m pip config list 2>/dev/null || python3 -m pip config list; } |
        sed -nE "s/^(global|install|download)\.([a-z-]+)='(.*)'$/\2 \3/p" |
        while read -r option value; do
            case $option in
                index-url | extra-index-url | find-links | no-index | trusted-host | proxy | cert | timeout | constraint)
                    printf 'PIP_%s=%s\n' "$(tr a-z- A-Z_ <<<"$option")" "${value//\\n/ }" ;;
            esac
        done
    env | grep -E '^(PIP_|[a-zA-Z]*_(proxy|PROXY)=|SSL_CERT_FILE=|REQUESTS_CA_BUNDLE=|NODE_EXTRA_CA_CERTS=|V3STUDIO_TORCH=)' || true
)
mapfile -t paths < <(grep -oE '(file://)?/[A-Za-z0-9._/-]+' <<<"$variables" | sort -u)

# create NAME: unpack a system into $work/NAME with a bare clone of HEAD in /srv, so that nothing uncommitted counts
create() {
    root=$work/$1
    mkdir "$root"
    tar -C "$root" --numeric-owner -xf "$base"
    cp /etc/resolv.conf "$root/etc/resolv.conf"
    apt-config dump Acquire | grep -E '^Acquire::(https?|Check-|Retries)\S* "[^"]*";$' >"$root/etc/apt/apt.conf.d/99host" || true
    printf '[safe]\n\tdirectory = *\n' >"$root/etc/gitconfig"
    git clone --quiet --bare --depth 1 "file://$PWD" "$root/srv/v3studio.git"
    settings=$variables
    for path in "${paths[@]}"; do
        if [ -f "$path" ]; then # a certificate: a copy, since the system's own file may be replaced
            cp "$path" "$root/etc/host-$(basename "$path")"
            settings=${settings//"$path"/"/etc/host-$(basename "$path")"}
        fi
    done
}

# inside USER SCRIPT: run a bash script in the system; its output also goes to $work/output
inside() {
    local user=$1 script=$2 home=/root
    [ "$user" = root ] || home=/home/$user
    namespace bash -c '
        set -e
        root=$1 cache=$2 suite=$3; shift 3
        mount -t proc proc "$root/proc"
        mount --rbind -o ro /sys "$root/sys"
        mount -t tmpfs -o mode=755 tmpfs "$root/dev"
        mkdir "$root/dev/shm"
        mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"
        ln -s /proc/self/fd "$root/dev/fd"
        for node in null:3 zero:5 full:7 random:8 urandom:9; do # its own, since the modes of the host may be unusual
            file=$root/dev/${node%:*}
            mknod -m 666 "$file" c 1 "${node#*:}" 2>&1 && { : <"$file"; } 2>&1 && continue
            rm -f "$file" && touch "$file" && mount --bind "/dev/${node%:*}" "$file" # in a container without mknod
        done
        touch "$root/dev/tty" && mount --bind /dev/tty "$root/dev/tty"
        bind() { mkdir -p "$root$2"; mount --bind "$1" "$root$2"; }
        chmod -R a+rwX "$cache/pip"
        bind "$cache/apt-$suite" /var/cache/apt/archives
        bind "$cache/pip" /var/cache/pip
        while [ "$1" != -- ]; do
            folder=${1#file://}
            [ "$folder" = "$1" ] || folder=$(dirname "$folder") # the pages of an index link to files beside it
            if [ -d "$folder" ]; then bind "$folder" "$folder"; fi
            shift
        done
        shift
        exec "$@"' enter "$root" "$cache" "$suite" "${paths[@]}" -- \
        chroot --userspec="$user" "$root" /usr/bin/env -i HOME="$home" USER="$user" TERM=dumb PIP_CACHE_DIR=/var/cache/pip \
        PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "${arguments[@]}" bash -c "cd $home; $script" \
        </dev/null >"$work/output" 2>&1
}
step() { # step WHAT USER SCRIPT
    local begin=$SECONDS
    if inside "$2" "$3"; then say "$1: ok ($((SECONDS - begin)) s)"; else
        tail -n 60 "$work/output"
        say "FAILED: $1"
        exit 1
    fi
}

stages='cd v3studio && .venv/bin/v3studio run sample_configs/demo.yaml --take ../take --capture.frames :2 --capture.scale 0.5
    --initialize.points 4000 --train.max-splats 4000 --train.keyframe-iterations 40 --train.prune-finetune-iterations 10
    --train.motion-iterations 10 --train.motion-first-iterations 10 --train.finetune-iterations 10
    && cd ../take && ls calibrate/rig.json initialize/group_000/mesh.ply stream/manifest.json report.html'
for user in root visitor; do
    create "$user"
    mapfile -t arguments <<<"$settings"
    step "$user: apt-get update" root "apt-get update -qq"
    [ "$user" = root ] || step "$user: adding a user" root "useradd --create-home --shell /bin/bash visitor"
    step "$user: git clone" "$user" "git clone --quiet /srv/v3studio.git v3studio"
    if [ "$user" != root ]; then
        if inside visitor "cd v3studio && make setup"; then say "FAILED: make setup passed although packages are missing"; exit 1; fi
        command=$(grep -E 'apt-get .*install' "$work/output" | sed -E 's/^ *//; s/\bsudo //g')
        [ "$(wc -l <<<"$command")" = 1 ] && [ -n "$command" ] || { cat "$work/output"; say "FAILED: not one command to paste"; exit 1; }
        say "visitor: make setup printed: $command"
        step "visitor: that command as root" root "$command"
    fi
    if [ -n "${FRESH_FULL:-}" ]; then
        step "$user: make demo" "$user" "cd v3studio && make demo"
        tail -n 25 "$work/output"
        [ "$user" = root ] || step "visitor: packages of the tests" root "cd ~visitor/v3studio && bash scripts/system_packages.sh --tests"
        step "$user: make test" "$user" "cd v3studio && make test"
        tail -n 15 "$work/output"
    else
        step "$user: make setup" "$user" "cd v3studio && make setup"
        step "$user: two frames of the sample capture" "$user" "${stages//$'\n'/ }"
    fi
    rm -rf --one-file-system "$root"
done
say "passed on $suite in $((SECONDS / 60)) minutes"
