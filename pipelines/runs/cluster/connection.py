"""The connection to a Ray cluster, with what can go wrong as one sentence each."""

import contextlib
import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from v3studio.studio.errors import StudioError

NAMESPACE = "v3studio"
ADDRESS_VARIABLE = "V3STUDIO_RAY_ADDRESS"
"""Environment variable of a detached run: the cluster's address where it runs, used instead of `run.address`."""

CONNECT_SECONDS = 5.0  # how long the head node may take to accept a connection

_EXTRA = "Install it: pip install 'ray[client]==2.60.0'."


def load_ray(address: str) -> Any:
    """The package, with token authentication on and usage statistics off unless the environment says otherwise.

    Without a network address, it uses the loopback interface only.
    """
    os.environ.setdefault("RAY_AUTH_MODE", "token")  # read when the package is imported
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if address == "local" or re.match(r"(ray://)?(127\.|localhost:|\[?::1)", address):
        # not only for Windows: otherwise Ray replaces loopback addresses by the machine's address in the network
        os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "1")  # tasks without a GPU see none
    try:
        import ray
    except ImportError:
        problem = "run.executor is ray, but Ray is not installed"
        raise StudioError("cluster.no_ray", problem, fix=_EXTRA, setting="run.executor") from None
    return ray


@contextmanager
def connected(address: str, cpus: int) -> Iterator[Any]:
    """Connect to a cluster, `run.address` or the environment variable `ADDRESS_VARIABLE`; "local" starts one with
    `cpus`. At the end everything that was started through the connection is stopped.

    StudioError if Ray is not installed (`cluster.no_ray`), nothing answers (`cluster.unreachable`), the token is wrong
    or missing (`cluster.token`), or the cluster has another version of Python or Ray (`cluster.version`).
    """
    address = os.environ.get(ADDRESS_VARIABLE) or address
    ray = load_ray(address)
    if ray.is_initialized():  # in a process that already uses the cluster
        yield ray
        return
    _check_port(address)
    options: dict[str, Any] = {"namespace": NAMESPACE, "log_to_driver": False, "configure_logging": False}
    if address == "local":
        options |= {"num_cpus": cpus, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    from ray.exceptions import AuthenticationError

    try:
        # Ray lets its workers import from the folder in which this is called
        with contextlib.chdir("/"):
            ray.init(address=address, **options)
    except AuthenticationError:
        raise _wrong_token(address) from None
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise _refused(address, error) from None
    try:
        yield ray
    finally:
        with contextlib.suppress(Exception):  # the cluster may be gone
            ray.shutdown()


def _check_port(address: str) -> None:
    """Ray itself waits half a minute for a head node that is not there."""
    parts = re.fullmatch(r"(?:ray://)?\[?([^\]/]+?)\]?:([0-9]{1,5})", address)
    if address in ("local", "auto"):
        return
    if parts is None:
        problem = f"'{address}' is not the address of a cluster"
        fix = "Example: ray://head:10001."
        raise StudioError("cluster.address", problem, value=address, fix=fix, setting="run.address")
    try:
        socket.create_connection((parts[1], int(parts[2])), timeout=CONNECT_SECONDS).close()
    except (OSError, OverflowError) as error:
        raise _unreachable(address, getattr(error, "strerror", None) or str(error)) from None


def _unreachable(address: str, reason: str) -> StudioError:
    problem = f"no Ray cluster answers at {address} ({reason})"
    fix = "Check run.address, and that the head node is running."
    return StudioError("cluster.unreachable", problem, value=address, fix=fix, setting="run.address")


def _wrong_token(address: str) -> StudioError:
    problem = f"the cluster at {address} does not accept the token"
    fix = "Set RAY_AUTH_TOKEN_PATH to the cluster's token file, or copy it to ~/.ray/auth_token."
    return StudioError("cluster.token", problem, value=address, fix=fix, setting="run.address")


def _refused(address: str, error: Exception) -> StudioError:
    text = " ".join(str(error).split())
    if re.search(r"token|unauthenticated|authenticat", text, re.IGNORECASE):
        return _wrong_token(address)
    if "ersion" in text and "Ray" in text and "Python" in text:
        versions = re.findall(r"(?:Ray|Python): ([0-9][0-9A-Za-z.]*)", text)
        told = f" ({', '.join(versions)})" if versions else ""
        problem = f"the cluster at {address} has other versions of Ray or Python than this machine{told}"
        fix = "Install the same versions on all machines."
        return StudioError("cluster.version", problem, value=address, fix=fix, setting="run.address")
    if address in ("local", "auto"):
        return _unreachable(address, text[:300])
    # the port was open: Ray tells a wrong token only in its log, and gives up after a minute
    problem = f"a program listens at {address}, but does not let this run in ({text[:300]})"
    fix = "Check the token (RAY_AUTH_TOKEN_PATH or ~/.ray/auth_token), and that the port is that of a Ray head node."
    return StudioError("cluster.token", problem, value=address, fix=fix, setting="run.address")
