"""Tests the setup on a freshly installed system; run by `make fresh-test`.

Builds a minimal Debian with debootstrap, to which only git, make and python3 are added, and runs two scenarios in it:

- As root: clone HEAD, run `make setup`, and process the first two frames of the sample capture through all stages with
  short schedules.
- In a new system, as a user without root or sudo: `make setup` must fail and print one command that installs everything
  that is missing. After this command is run as root, `make setup` must pass.

    FRESH_SUITE=trixie make fresh-test      another release (default: bookworm)
    FRESH_MIRROR=http://... make fresh-test another archive (default: the one in this machine's apt sources)
    FRESH_DIR=/big/disk make fresh-test     folder to unpack in, with at least 8 GB free (default: /var/tmp)
    V3STUDIO_TORCH=cuda make fresh-test     the CUDA build of PyTorch, where its CPU build cannot be downloaded
    FRESH_ARGS=--full make fresh-test       full `make demo` and `make test` instead of two frames (about an hour)

Requires Linux, root, unshare, debootstrap (installed with apt-get if possible) and a package mirror. If these are not
available, the test is skipped with a message and exit status 0; with CI=true in the environment the status is 1, since
CI relies on the test.

Every step runs in its own mount and PID namespace, so its mounts and processes are never visible outside and disappear
when it ends, even if it is killed. This machine's pip settings (indexes, find-links, certificates, proxies), the
folders that they refer to, and apt's download settings are made available in the test system. The base system and all
downloads are cached in ${XDG_CACHE_HOME:-~/.cache}/v3studio/fresh for the next run.
"""

from __future__ import annotations

import argparse
import ast
import configparser
import fcntl
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
TOOLS = "git,make,python3"
BASE_DAYS = 14
"""Age in days after which a cached base system is rebuilt."""

FREE_GIGABYTES = 8
CERTIFICATES = "/etc/host-certificates"
PROXIES = ("http_proxy", "https_proxy", "all_proxy", "no_proxy")
CERTIFICATE_VARIABLES = ("SSL_CERT_FILE", "REQUESTS_CA_BUNDLE", "CURL_CA_BUNDLE", "NODE_EXTRA_CA_CERTS")
PIP_INDEXES = ("index-url", "extra-index-url")
PIP_CERTIFICATES = ("cert", "client-cert")
PIP_OPTIONS = (
    *PIP_INDEXES,
    *PIP_CERTIFICATES,
    *("find-links", "no-index", "trusted-host", "proxy", "timeout", "default-timeout", "retries", "prefer-binary"),
)
"""The pip settings that determine how packages are downloaded; others (targets, users, logs) are not copied."""

NO_NAMESPACE = 97
"""Exit status of a step whose mounts were denied."""

# $1: folder of the test system; $2: file with "SOURCE TARGET ro|rw" lines; remaining arguments: the command.
ENTER = f"""
set -e
root=$1 binds=$2; shift 2
{{
    mount -t proc proc "$root/proc"
    mount -t sysfs -o ro sysfs "$root/sys" || mount --rbind -o ro /sys "$root/sys"
    mount -t tmpfs -o mode=755 tmpfs "$root/dev"
    mkdir "$root/dev/pts" "$root/dev/shm"
    mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"
    mount -t devpts -o newinstance,ptmxmode=0666 devpts "$root/dev/pts"
    ln -s pts/ptmx "$root/dev/ptmx"
    ln -s /proc/self/fd "$root/dev/fd"
    for node in null zero full random urandom tty; do
        touch "$root/dev/$node"
        mount --bind "/dev/$node" "$root/dev/$node"
    done
    while IFS=$'\\t' read -r source target mode; do
        mkdir -p "$root$target"
        mount --bind "$source" "$root$target"
        [ "$mode" = rw ] || mount -o remount,bind,ro "$root$target"
    done <"$binds"
}} || exit {NO_NAMESPACE}
exec "$@"
"""

STAGES = (
    ".venv/bin/v3studio run sample_configs/quickstart.yaml --take ../take --capture.stop 2 --capture.scale 0.5"
    " --initialize.points 4000 --train.max-splats 4000 --train.keyframe-iterations 40"
    " --train.prune-finetune-iterations 10 --train.motion-iterations 10 --train.motion-first-iterations 10"
    " --train.finetune-iterations 10"
)
MADE = ("calibrate/rig.json", "initialize/group_000/mesh.ply", "stream/manifest.json", "report.html")


class CannotRun(Exception):
    """The test cannot run on this machine; the text is the reason."""


class Failed(Exception):
    """The setup failed; the text describes the step."""


# Settings of this machine


@dataclass(frozen=True)
class Carried:
    """Settings of this machine for the test system.

    Attributes:
        environment: environment variables, including PIP_*.
        pip_conf: content of /etc/pip.conf.
        folders: folders that are mounted read-only at the same path.
        certificates: path in the test system to the file on this machine that is copied there.
    """

    environment: dict[str, str]
    pip_conf: str
    folders: tuple[str, ...]
    certificates: dict[str, str]


def carry(pip_config: str, environment: Mapping[str, str]) -> Carried:
    """The settings that downloads need, from the output of `pip config list` and the environment of this process."""
    folders: set[str] = set()
    certificates: dict[str, str] = {}

    def certificate(path: str) -> str:
        inside = f"{CERTIFICATES}/{hashlib.sha256(path.encode()).hexdigest()[:8]}.pem"
        certificates[inside] = path
        return inside

    def take_in(option: str, value: str) -> str:
        if option in PIP_CERTIFICATES:
            return certificate(value) if os.path.isfile(value) else value
        for word in value.split():
            path = unquote(urlsplit(word).path) if word.startswith("file:") else word
            if os.path.isdir(path) and os.path.isabs(path):
                # The pages of an index link to files next to it.
                parent = os.path.dirname(os.path.normpath(path))
                folders.add(parent if option in PIP_INDEXES and parent != "/" else os.path.normpath(path))
        return value

    config = configparser.RawConfigParser()
    carried_environment = {}
    for line in pip_config.splitlines():
        key, equals, value = line.partition("=")
        section, dot, option = key.rpartition(".")
        if not (equals and dot and option in PIP_OPTIONS and section != ":env:"):
            continue
        if not config.has_section(section):
            config.add_section(section)
        config.set(section, option, take_in(option, str(ast.literal_eval(value))).replace("\n", "\n\t"))
    for name, value in environment.items():
        option = name.removeprefix("PIP_").lower().replace("_", "-")
        if name.startswith("PIP_") and option in PIP_OPTIONS:
            carried_environment[name] = take_in(option, value)
        elif name.lower() in PROXIES or name == "V3STUDIO_TORCH":
            carried_environment[name] = value
        elif name in CERTIFICATE_VARIABLES and os.path.isfile(value):
            carried_environment[name] = certificate(value)
    lines = []
    for section in config.sections():
        lines += [f"[{section}]", *(f"{option} = {value}" for option, value in config.items(section))]
    return Carried(carried_environment, "\n".join([*lines, ""]), tuple(sorted(folders)), certificates)


def apt_downloads(dump: str) -> str:
    """The lines of `apt-config dump` that affect downloads: proxies, retries, date checks."""
    wanted = re.compile(r'^Acquire::(https?|Check-|Retries|ForceIPv[46])\S* "[^"]*";$')
    return "".join(line + "\n" for line in dump.splitlines() if wanted.match(line) and "Detect" not in line)


def archives(index_targets: str) -> tuple[str | None, str | None]:
    """apt's Debian or Ubuntu archive and security archive, from lines "URI|origin|label"; None if there is none."""
    main = security = None
    for line in index_targets.splitlines():
        uri, origin, label = [*line.split("|"), "", ""][:3]
        if origin in ("Debian", "Ubuntu") and label == origin:
            main = main or uri
        elif label == "Debian-Security":
            security = security or uri
    return main, security


def pasted_command(output: str) -> str:
    """The command that `make setup` printed for users without root.

    Raises:
        Failed: it printed no such command, or several.
    """
    commands = r"((?:su -c |sudo |apt-get (?:-\S+ )*(?:update|install)\b).*)$"
    found = [command for command in re.findall(commands, output, re.MULTILINE) if " install " in command]
    if len(found) != 1:
        raise Failed(f"`make setup` without root printed {len(found)} commands that install packages, expected 1")
    return found[0].rstrip("`. ")


def as_root(command: str) -> str:
    """The command without sudo, for a root shell on a system that does not have sudo."""
    return re.sub(r"\bsudo\s+", "", command)


# The test system


def say(text: str) -> None:
    """Print progress immediately, even if standard output is a pipe."""
    print(f"fresh-test: {text}", flush=True)


def cache_folder() -> Path:
    """Folder in which base systems and downloads are cached."""
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(base) / "v3studio" / "fresh"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def output_of(*command: str) -> str:
    """Standard output of a command; empty if it fails or does not exist."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""


def check_machine(work: Path) -> None:
    """Check that the test can run on this machine; installs debootstrap if it is missing.

    Raises:
        CannotRun: the test cannot run.
    """
    if sys.platform != "linux":
        raise CannotRun("it needs Linux")
    if os.geteuid() != 0:
        raise CannotRun("it needs root; run it with sudo or in a container")
    if (
        not shutil.which("unshare")
        or subprocess.run(
            ["unshare", "--mount", "--pid", "--fork", "mount", "-t", "tmpfs", "tmpfs", "/mnt"], capture_output=True
        ).returncode
    ):
        raise CannotRun("mount namespaces are not allowed (a container needs --privileged or CAP_SYS_ADMIN)")
    if not shutil.which("debootstrap"):
        if not shutil.which("apt-get"):
            raise CannotRun("debootstrap is not installed")
        say("installing debootstrap")
        for command in (["update", "-qq"], ["install", "-y", "-qq", "--no-install-recommends", "debootstrap"]):
            done = subprocess.run(["apt-get", *command], capture_output=True, text=True, stdin=subprocess.DEVNULL)
        if done.returncode:
            raise CannotRun(f"debootstrap cannot be installed: {(done.stderr.strip().splitlines() or ['?'])[-1]}")
    free = shutil.disk_usage(work).free / 1e9
    if free < FREE_GIGABYTES:
        raise CannotRun(f"{work} has {free:.0f} GB free, expected at least {FREE_GIGABYTES}; set FRESH_DIR")


def find_archives() -> tuple[str, str | None]:
    """The package archive to install from, and its security archive or None."""
    if os.environ.get("FRESH_MIRROR"):
        return os.environ["FRESH_MIRROR"], os.environ.get("FRESH_SECURITY_MIRROR")
    query = ["apt-get", "indextargets", "--format", "$(REPO_URI)|$(ORIGIN)|$(LABEL)", "Created-By: Packages"]
    main, security = archives(output_of(*query))
    if main is None:  # the lists have not been downloaded
        output_of("apt-get", "update", "-qq")
        main, security = archives(output_of(*query))
    if main is None:
        raise CannotRun("no Debian or Ubuntu archive in apt's sources is reachable; set FRESH_MIRROR")
    return main, security


def base_system(suite: str, mirror: str, work: Path) -> Path:
    """A tar file of the minimal system, from the cache or newly built."""
    cache = cache_folder()
    key = hashlib.sha256(f"{mirror} {TOOLS}".encode()).hexdigest()[:8]
    tar = cache / f"{suite}-{os.uname().machine}-{key}.tar"
    if tar.exists() and time.time() - tar.stat().st_mtime < BASE_DAYS * 86400:
        return tar
    begun = time.monotonic()
    root, log, partial = work / "base", work / "debootstrap.log", tar.with_suffix(f".{os.getpid()}")
    command = ["debootstrap", "--variant=minbase", f"--include={TOOLS}", suite, str(root), mirror]
    with open(log, "wb") as out:
        # In a namespace, since debootstrap mounts /proc in the system that it builds.
        status = in_namespace(command, stdout=out)
    if status:
        last = log.read_text(errors="replace").strip().splitlines()[-3:]
        raise CannotRun(f"debootstrap {suite} from {mirror} failed: {' / '.join(last)}")
    try:
        # Without devices (a fresh /dev is mounted) and without downloaded package files.
        leave_out = ["--exclude=./dev/*", "--exclude=./var/cache/apt/archives/*.deb"]
        subprocess.run(["tar", "-C", root, "--numeric-owner", *leave_out, "-cf", partial, "."], check=True)
        partial.replace(tar)
    finally:
        partial.unlink(missing_ok=True)
    remove_tree(root)
    say(f"built a minimal {suite} in {time.monotonic() - begun:.0f} s")
    return tar


def in_namespace(command: list[str], **streams: object) -> int:
    """Run a command in its own mount and PID namespace; it is killed with all its children if this process stops."""
    whole = ["unshare", "--mount", "--pid", "--fork", "--kill-child", *command]
    process = subprocess.Popen(
        whole,
        stdin=streams.get("stdin", subprocess.DEVNULL),
        stdout=streams["stdout"],
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        return process.wait()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def remove_tree(tree: Path) -> None:
    """Delete the folder of a test system, after checking that nothing is mounted in it.

    Raises:
        RuntimeError: something is mounted in it; nothing was deleted.
    """
    mounts = [line.split()[4] for line in Path("/proc/self/mountinfo").read_text().splitlines()]
    inside = [mount for mount in mounts if Path(mount).is_relative_to(tree.resolve())]
    if inside:
        raise RuntimeError(f"{inside[0]} is mounted; {tree} was not deleted")
    subprocess.run(["rm", "-rf", "--one-file-system", str(tree)], check=True)


class System:
    """An unpacked minimal system with this machine's download settings and the repository in /srv."""

    def __init__(self, name: str, tar: Path, work: Path, carried: Carried, suite: str, security: str | None) -> None:
        self.name = name
        self.root = work / name
        self.log = work / f"{name}.log"
        self.environment = dict(carried.environment)
        self.root.mkdir()
        subprocess.run(["tar", "-C", self.root, "--numeric-owner", "-xf", tar], check=True)
        self._write("/etc/pip.conf", carried.pip_conf)
        self._write("/etc/resolv.conf", Path("/etc/resolv.conf").read_text())
        self._write("/etc/apt/apt.conf.d/99host", apt_downloads(output_of("apt-config", "dump", "Acquire")))
        if security:
            self._write("/etc/apt/sources.list.d/security.list", f"deb {security} {suite}-security main\n")
        for inside, outside in carried.certificates.items():
            self._write(inside, Path(outside).read_text())
        self.binds = work / f"{name}.binds"
        cached = [
            (cache_folder() / f"apt-{suite}", "/var/cache/apt/archives"),
            (cache_folder() / "pip", "/var/cache/pip"),
        ]
        for folder, _ in cached:
            folder.mkdir(exist_ok=True)
            folder.chmod(0o777)  # pip only uses its cache if the user may write to it
        lines = [f"{folder}\t{inside}\trw" for folder, inside in cached]
        lines += [f"{folder}\t{folder}\tro" for folder in carried.folders]
        self.binds.write_text("".join(line + "\n" for line in lines))
        self.environment["PIP_CACHE_DIR"] = "/var/cache/pip"
        # Otherwise, git refuses to read repositories owned by other users.
        self._write("/etc/gitconfig", "[safe]\n\tdirectory = *\n")
        # A bare clone of HEAD, so that files that are not committed cannot affect the test.
        cloned = subprocess.run(
            ["git", "clone", "--quiet", "--bare", "--depth", "1", ROOT.as_uri(), self.root / "srv" / "v3studio.git"],
            env={**os.environ, "GIT_CONFIG_GLOBAL": str(self.root / "etc" / "gitconfig")},
            capture_output=True,
            text=True,
        )
        if cloned.returncode:
            raise CannotRun(f"git cannot clone {ROOT}: {' '.join(cloned.stderr.split())}")

    def _write(self, inside: str, text: str) -> None:
        path = self.root / inside.lstrip("/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # may be a dangling link
        path.write_text(text)

    def run(self, script: str, *, user: str = "root", answer: str = "") -> tuple[int, str]:
        """Run a bash script in the system; returns its exit status and its combined standard output and error."""
        home = "/root" if user == "root" else f"/home/{user}"
        variables = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": home, "USER": user}
        variables |= self.environment
        inner = ["chroot", f"--userspec={user}", str(self.root), "/usr/bin/env", "-i"]
        inner += [f"{name}={value}" for name, value in variables.items()]
        inner += ["bash", "-c", f"cd {home}\n{script}"]
        with open(self.log, "a+b") as log, tempfile.TemporaryFile() as stdin:
            start = log.seek(0, os.SEEK_END)
            stdin.write(answer.encode())
            stdin.seek(0)
            command = ["bash", "-c", ENTER, "enter", str(self.root), str(self.binds), *inner]
            status = in_namespace(command, stdout=log, stdin=stdin)
            log.seek(start)
            output = log.read().decode(errors="replace")
        if status == NO_NAMESPACE:
            raise CannotRun(f"mounting in {self.root} is not allowed: {' '.join(output.split())[-300:]}")
        return status, output

    def step(self, what: str, script: str, *, user: str = "root", answer: str = "", fails: bool = False) -> str:
        """Run a script that must pass, or with `fails` must fail; returns its output.

        Raises:
            Failed: it did not; the message ends with the last lines of its output.
        """
        begun = time.monotonic()
        status, output = self.run(script, user=user, answer=answer)
        verdict = "failed as expected" if fails and status else "ok" if not status else f"FAILED with status {status}"
        say(f"{self.name}: {what}: {verdict} ({time.monotonic() - begun:.0f} s)")
        if bool(status) != fails:
            tail = "\n".join(line for line in output.splitlines() if line.strip())[-6000:]
            how = "passed although packages are missing" if fails else f"failed with status {status}"
            raise Failed(f"{self.name}: {what} {how}:\n{tail}")
        return output


# The two scenarios

CLONE = "git clone --quiet /srv/v3studio.git v3studio"


def run_stages(system: System, user: str) -> None:
    """Process two frames through all stages and check that the results exist."""
    take = f"{'/root' if user == 'root' else f'/home/{user}'}/take"
    system.step("two frames of the sample capture", f"cd v3studio && {STAGES}", user=user)
    for name in MADE:
        if not (system.root / take.lstrip("/") / name).is_file():
            raise Failed(f"{system.name}: the run passed, but {name} was not created")


def demo_and_test(system: System, user: str) -> None:
    """Run both commands of the README in full; prints the ends of their outputs and the disk space that they take."""
    output = system.step("make demo", "cd v3studio && make demo", user=user)
    say("\n".join(output.splitlines()[-25:]))
    checked = system.step(
        "the demo's stream", "cd v3studio/demo-take/stream && sha256sum manifest.json && du -sb .", user=user
    )
    say(checked)
    if user != "root":
        paste_command_of(system, "make test", user)
    output = system.step("make test", "cd v3studio && make test", user=user)
    say("\n".join(output.splitlines()[-15:]))
    say(system.step("disk space", "cd v3studio && du -smc .venv build web/node_modules demo-take", user=user))


def paste_command_of(system: System, make: str, user: str) -> None:
    """Run a make target that fails because system packages are missing, then run the command that it prints as root."""
    output = system.step(f"{make} before the packages are installed", f"cd v3studio && {make}", user=user, fails=True)
    command = pasted_command(output)
    say(f"{system.name}: it printed: {command}")
    system.step("that command as root", as_root(command), answer="y\n" * 3)


def as_root_user(system: System, full: bool) -> None:
    """Run the README's commands as root."""
    refresh(system)
    system.step("git clone", CLONE)
    if full:
        demo_and_test(system, "root")
        return
    system.step("make setup", "cd v3studio && make setup")
    run_stages(system, "root")


def as_ordinary_user(system: System, full: bool) -> None:
    """Run the README's commands without root: they fail, print a command to paste, and pass after it was run."""
    refresh(system)
    system.step("adding a user", "useradd --create-home --shell /bin/bash visitor")
    system.step("git clone", CLONE, user="visitor")
    paste_command_of(system, "make demo" if full else "make setup", "visitor")
    if full:
        demo_and_test(system, "visitor")
        return
    system.step("make setup", "cd v3studio && make setup", user="visitor")
    run_stages(system, "visitor")


def refresh(system: System) -> None:
    """Check that the mirror is reachable, so that later failures are not caused by the network.

    Raises:
        CannotRun: the mirror is not reachable.
    """
    status, output = system.run("apt-get update -qq")
    if status:
        raise CannotRun(f"apt-get update failed in the minimal system: {' '.join(output.split())[-300:]}")
    # As on a newly installed machine, where package lists are outdated or missing.
    system.run("rm -rf /var/lib/apt/lists/*")


SCENARIOS = {"root": as_root_user, "user": as_ordinary_user}


def share_downloads() -> None:
    """Let other users read the cache of root's pip, whose files are only readable by their owner."""
    subprocess.run(["chmod", "-R", "a+rX", str(cache_folder() / "pip")], check=True)


def run(suite: str, names: Iterable[str], keep: bool, full: bool) -> None:
    """Run the scenarios one after the other.

    Raises:
        CannotRun: the test cannot run on this machine.
        Failed: a step failed.
    """
    place = Path(os.environ.get("FRESH_DIR") or "/var/tmp")
    check_machine(place)
    lock = open(cache_folder() / "lock", "w")  # noqa: SIM115 (held until this process ends)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        say("waiting for another run to end, since runs share the downloads")
        fcntl.flock(lock, fcntl.LOCK_EX)
    mirror, security = find_archives()
    python = ROOT / ".venv" / "bin" / "python"  # has pip even if the system's Python does not
    python = str(python) if python.exists() else sys.executable
    carried = carry(output_of(python, "-m", "pip", "config", "list"), os.environ)
    work = Path(tempfile.mkdtemp(prefix="v3studio-fresh-", dir=place))
    work.chmod(0o755)  # other users must be able to access the test system
    try:
        say(f"{suite} from {mirror}")
        tar = base_system(suite, mirror, work)
        for name in names:
            system = System(name, tar, work, carried, suite, security)
            SCENARIOS[name](system, full)
            share_downloads()
            if not keep:
                remove_tree(system.root)
    finally:
        if keep:
            say(f"kept {work}; delete it when you are done")
        else:
            remove_tree(work)


def main() -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(description="Test the setup in a minimal Debian; see the docstring of this file.")
    parser.add_argument("--suite", default=os.environ.get("FRESH_SUITE") or "bookworm")
    parser.add_argument("--only", choices=SCENARIOS, help="run only one of the two scenarios")
    parser.add_argument("--keep", action="store_true", help="keep the folders and logs of the test systems")
    parser.add_argument("--full", action="store_true", help="run `make demo` and `make test` in full")
    given = parser.parse_args()

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGHUP, stop)
    begun = time.monotonic()
    try:
        run(given.suite, [given.only] if given.only else list(SCENARIOS), given.keep, given.full)
    except CannotRun as reason:
        if os.environ.get("CI", "").lower() in ("1", "true", "yes"):
            print(f"fresh-test: CANNOT RUN, and CI relies on it: {reason}", file=sys.stderr)
            return 1
        print(f"fresh-test: SKIPPED: {reason}")
        return 0
    except Failed as failure:
        print(f"fresh-test: FAILED: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("fresh-test: stopped", file=sys.stderr)
        return 130
    say(f"passed on {given.suite} in {(time.monotonic() - begun) / 60:.1f} minutes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
