"""An S3 server (moto) in this process, which counts requests and can be made slow, unreliable or full."""

import itertools
import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

KEY, SECRET = "AKIAV3STUDIOTEST", "a-secret-that-no-message-shows"
BUCKET = "studio"


@dataclass
class Faults:
    """Faults of the server.

    Attributes:
        failing: share of requests that are answered with status 500.
        truncated: share of GET answers that end early.
        delay: seconds before each answer.
    """

    failing: float = 0.0
    truncated: float = 0.0
    delay: float = 0.0


@dataclass
class ObjectStore:
    """The running server.

    Attributes:
        url: its address.
        faults: may be changed at any time.
        gets: how often each (key, range) was read successfully.
        failed: number of requests that failed on purpose.
    """

    url: str = ""
    faults: Faults = field(default_factory=Faults)
    gets: Counter[tuple[str, str]] = field(default_factory=Counter)
    failed: int = 0
    _random: random.Random = field(default_factory=lambda: random.Random(1))
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def client(self) -> Any:
        """boto3's client, for tests to look at the bucket; its requests are neither counted nor disturbed."""
        import boto3

        client = boto3.client(
            "s3", endpoint_url=self.url, aws_access_key_id=KEY, aws_secret_access_key=SECRET, region_name="us-east-1"
        )
        client.meta.events.register("before-sign.s3", lambda request, **_: request.headers.add_header("X-Test", "1"))
        return client

    def reset(self) -> None:
        """Empty the bucket; no faults, nothing counted."""
        self.faults, self.failed = Faults(), 0
        self._random.seed(1)  # faults do not depend on the tests before
        self.gets.clear()
        client = self.client
        for page in client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET):
            for about in page.get("Contents", ()):
                client.delete_object(Bucket=BUCKET, Key=about["Key"])

    def fetched_twice(self, prefix: str) -> list[str]:
        """Objects below a folder of the bucket of which some byte was read more than once."""
        ranges: dict[str, list[tuple[int, int]]] = {}
        for (key, asked), count in self.gets.items():
            if key.startswith(f"{prefix}/"):
                first, _, last = asked.removeprefix("bytes=").partition("-")
                ranges.setdefault(key, []).extend([(int(first or 0), int(last or 1 << 62))] * count)
        return [
            key
            for key, found in ranges.items()
            if any(after[0] <= before[1] for before, after in itertools.pairwise(sorted(found)))
        ]

    def upload(self, folder: Path, prefix: str) -> None:
        """Copy a folder into the bucket."""
        client = self.client
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                key = f"{prefix}/{path.relative_to(folder).as_posix()}"
                client.put_object(Bucket=BUCKET, Key=key, Body=path.read_bytes())

    def environment(self, cache: Path) -> dict[str, str]:
        """Variables that make v3studio use this server, and a cache of its own."""
        return {
            "AWS_ENDPOINT_URL": self.url,
            "AWS_ACCESS_KEY_ID": KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET,
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_EC2_METADATA_DISABLED": "true",
            "V3STUDIO_CACHE": str(cache),
        }

    def application(self, moto: Callable[..., Iterable[bytes]]) -> Callable[..., Iterable[bytes]]:
        """moto's application, with faults."""

        def answer(environ: dict[str, Any], start_response: Callable[..., Any]) -> Iterable[bytes]:
            if environ.get("HTTP_X_TEST"):
                return moto(environ, start_response)
            faults, method = self.faults, environ["REQUEST_METHOD"]
            time.sleep(faults.delay)
            if KEY not in environ.get("HTTP_AUTHORIZATION", ""):
                return _error(start_response, "403 Forbidden", "InvalidAccessKeyId", "The key does not exist")
            with self._lock:
                fails = self._random.random() < faults.failing
                short = method == "GET" and self._random.random() < faults.truncated
                self.failed += fails or short
            if fails:
                return _error(start_response, "500 Internal Server Error", "InternalError", "injected")
            key = environ["PATH_INFO"].removeprefix(f"/{BUCKET}").lstrip("/")
            body = moto(environ, start_response)
            if not key:
                return body
            if short:
                whole = b"".join(body)
                return [whole[: len(whole) // 2]]  # the header announces the whole length
            with self._lock:
                if method == "GET":
                    self.gets[key, environ.get("HTTP_RANGE", "")] += 1
            return body

        return answer


def _error(start_response: Callable[..., Any], status: str, code: str, text: str) -> list[bytes]:
    body = f'<?xml version="1.0"?><Error><Code>{code}</Code><Message>{text}</Message></Error>'.encode()
    start_response(status, [("Content-Type", "application/xml"), ("Content-Length", str(len(body)))])
    return [body]


@contextmanager
def object_store() -> Iterator[ObjectStore]:
    """A server with an empty bucket `BUCKET`; it ends with the block."""
    from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
    from werkzeug.serving import WSGIRequestHandler, make_server

    class Quiet(WSGIRequestHandler):
        def log(self, *arguments: Any) -> None:
            return

    store = ObjectStore()
    application = store.application(DomainDispatcherApplication(create_backend_app))
    server = make_server("127.0.0.1", 0, application, threaded=True, request_handler=Quiet)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    store.url = f"http://127.0.0.1:{server.port}"
    try:
        client = store.client
        client.create_bucket(Bucket=BUCKET)
        yield store
    finally:
        server.shutdown()
        thread.join()
