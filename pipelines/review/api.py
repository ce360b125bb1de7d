"""The routes below `.review/`: figures, footage images, marks. Anyone who reaches them may read and mark.

The caller decides who reaches them: `v3studio serve --review` puts them below a secret path.
"""

import asyncio
import hashlib
import re
from collections.abc import Callable
from typing import Any, TypeVar

from pydantic import ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from v3studio.pipelines.reports.terminal import say
from v3studio.pipelines.review.messages import MarkChange, MarkList
from v3studio.pipelines.review.take_review import TakeReview
from v3studio.studio.errors import StudioError

FOLDER = ".review"  # hidden files of streams are not served, so that no stream can have a folder of that name
MAX_BODY_BYTES = 64_000  # longest change of a mark
BODY_SECONDS = 10.0  # A change must have arrived within this time
AT_ONCE = 2  # pictures and figures that are computed at the same time; the others wait

_STATUS = {
    "take.mark_changed": 409,
    "take.mark_too_long": 413,
    "take.mark_too_far": 400,
    "take.too_many_marks": 409,
    "review.no_frame": 404,
    "review.no_camera": 404,
}
Made = TypeVar("Made")

_FRAME = re.compile(r"[0-9]{1,9}")
_PRIVATE = {"X-Content-Type-Options": "nosniff", "Cross-Origin-Resource-Policy": "same-origin"}


def review_routes(review: TakeReview) -> list[BaseRoute]:
    """Routes of a take, relative to `FOLDER` below its stream.

    GET `data.json` and `frames/CAMERA/FRAME.jpg`, GET and POST `marks`, as in `pipelines.review.messages`. Refused
    changes are answered with a sentence and all marks as they are: 409 if somebody else changed the mark.
    """
    working = asyncio.Semaphore(AT_ONCE)

    def answer(message: MarkList, status: int = 200) -> Response:
        body = message.model_dump_json().encode()
        headers = {**_PRIVATE, "Cache-Control": "no-cache", "ETag": f'"{hashlib.sha256(body).hexdigest()[:32]}"'}
        return Response(body, status, headers, "application/json")

    async def computed(make: Callable[..., Made], *given: Any) -> Made:
        async with working:
            try:
                return await run_in_threadpool(make, *given)
            except StudioError as error:
                if error.code not in _STATUS:  # details concern this machine only
                    say(f"warning: {error}", error=True)
                raise HTTPException(_STATUS.get(error.code, 500)) from None

    async def data(request: Request) -> Response:
        figures = await computed(review.data)
        headers = {**_PRIVATE, "Cache-Control": "no-cache"}
        return Response(figures.model_dump_json(), headers=headers, media_type="application/json")

    async def picture(request: Request) -> Response:
        camera, frame = request.path_params["camera"], request.path_params["frame"]
        if _FRAME.fullmatch(frame) is None:
            raise HTTPException(404)
        # the address is secret and changes with every run of the server
        headers = {**_PRIVATE, "Cache-Control": "private, max-age=86400, immutable"}
        return Response(await computed(review.picture, camera, int(frame)), headers=headers, media_type="image/jpeg")

    async def marks(request: Request) -> Response:
        try:
            if request.method == "POST":
                return answer(MarkList(marks=await run_in_threadpool(review.change, await _change(request))))
            current = answer(MarkList(marks=await run_in_threadpool(review.marks)))
        except StudioError as error:
            status = _STATUS.get(error.code, 500)
            if status == 500:
                say(f"warning: {error}", error=True)
            return answer(await run_in_threadpool(_refused, review, error), status)
        if request.headers.get("if-none-match") == current.headers["etag"]:
            return Response(status_code=304, headers={**_PRIVATE, "ETag": current.headers["etag"]})
        return current

    return [
        Route("/data.json", data, methods=["GET"]),
        Route("/frames/{camera}/{frame}.jpg", picture, methods=["GET"]),
        Route("/marks", marks, methods=["GET", "POST"]),
    ]


def _refused(review: TakeReview, error: StudioError) -> MarkList:
    """Why, without paths of this machine, and the marks if they can be read."""
    problem = error.problem[:1].upper() + error.problem[1:]
    try:
        return MarkList(marks=review.marks(), problem=f"{problem}.")
    except StudioError:
        return MarkList(marks=None, problem=f"{problem}.")


async def _change(request: Request) -> MarkChange:
    """The body of a request, if it is a change of a mark, small, and there in time; else raises HTTPException."""
    # pages of other origins can send this type only after asking, which is not granted
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "application/json":
        raise HTTPException(415, "Send application/json.")

    async def read() -> bytes:
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > MAX_BODY_BYTES:
                raise HTTPException(413, f"More than {MAX_BODY_BYTES} bytes.")
        return bytes(body)

    try:
        return MarkChange.model_validate_json(await asyncio.wait_for(read(), BODY_SECONDS))
    except ClientDisconnect:  # nobody reads the answer
        raise HTTPException(400, "The request ended early.") from None
    except TimeoutError:
        raise HTTPException(408, "The request did not arrive in time.") from None
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"])) or "the body"
        raise HTTPException(400, f"{where[:80]}: {first['msg'][:200]}") from None
