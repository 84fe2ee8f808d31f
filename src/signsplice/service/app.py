"""Routes of the service, which validate requests and pass them to worker processes, and the service on a socket."""

from __future__ import annotations

import base64
import errno
import hashlib
import os
import socket
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import ExitStack, asynccontextmanager
from dataclasses import replace
from importlib.metadata import version
from math import ceil
from typing import Annotated, Any, Literal, TypeVar
from urllib.parse import quote

import uvicorn
from fastapi import FastAPI, File, Form, Query, Request, UploadFile, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.docs import get_swagger_ui_html
from pydantic import TypeAdapter, ValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import JSONResponse, Response
from starlette.staticfiles import StaticFiles

from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.formats import WIRE_SUFFIXES, join_suffixes
from signsplice.formats.avatar import AVATAR_SUFFIXES
from signsplice.lexicon.lexicon import open_lexicon
from signsplice.service import page, wire, work
from signsplice.service.avatars import UploadedAvatars
from signsplice.service.fair_queue import FairQueue
from signsplice.service.limits import Limits, Shares, caller, while_connected
from signsplice.service.monitoring import CountRequests, Metrics, quieten
from signsplice.service.scene import safe_name
from signsplice.service.settings import Settings
from signsplice.service.streaming import TRY_AGAIN_LATER, StreamSession, failure, first_fault
from signsplice.service.workers import BusyError, Worker
from signsplice.splicing.options import all_methods

ResultT = TypeVar("ResultT")

_SPLICE_OPTIONS: TypeAdapter[wire.SpliceRequest] = TypeAdapter(wire.SpliceRequest)
_FIT_OPTIONS: TypeAdapter[wire.SentenceRequest] = TypeAdapter(wire.SentenceRequest)
_FAILURES: dict[int | str, dict[str, Any]] = {
    status: {"model": wire.Failure, "description": description}
    for status, description in (
        (400, "The request or its body cannot be parsed, or it has two Host headers."),
        (403, "The request comes from a page of another origin."),
        (408, "The body arrives too slowly."),
        (413, "The body is too long."),
        (415, "The body is compressed."),
        (421, "The Host header is not one of the service's names."),
        (422, "The request cannot be carried out; the message gives the reason, and what to do."),
        (503, "The service is busy; try again in a moment."),
    )
}
_SPLICED: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {"text/plain": {}, "model/gltf-binary": {}, "image/png": {}, "image/gif": {}},
        "description": "A splice, or one file of it.",
    }
}
_UPLOAD_SECONDS = 1.0
"""Expected work of a request with files, s: it is unknown until they are read, and then what was done counts."""
_AvatarFile = Annotated[
    UploadFile, File(description=f"{join_suffixes(AVATAR_SUFFIXES)}, whole: no other file is read.")
]
_RECEIVE_BYTES, _SEND_BYTES = 4 * 1024, 96 * 1024
"""Buffers of a connection, bytes; Linux doubles them. What is received at once is parsed in one step."""
_ONE_FILE = "Answer with this one file instead of JSON; png: a contact sheet, gif: a film."


class Service:
    """State shared by the routes: settings, lexicon, worker processes and counters."""

    def __init__(self, settings: Settings, scenes: Sequence[Mapping[str, Any]]) -> None:
        self.settings, self.scenes = settings, scenes
        self.lexicon = open_lexicon(*settings.lexicons)
        self.lexicon.verify()
        self.quick_workers: list[Worker] = []
        self.long_workers: list[Worker] = []
        self.queue = FairQueue(self.long_workers)
        self.requests = Shares("requests that wait", settings.max_connections, settings.max_client_waiting)
        self.streams = Shares("streams", settings.max_streams, settings.max_client_streams)
        self.avatars = UploadedAvatars(settings)
        self.n_streams: Counter[Worker] = Counter()
        self.metrics = Metrics(
            lambda: self.requests.n_held,
            lambda: sum(worker.n_lost for worker in self._workers),
            lambda: self.queue.wait_seconds,
        )

    @property
    def _workers(self) -> list[Worker]:
        return [*self.quick_workers, *self.long_workers]

    @asynccontextmanager
    async def lifespan(self, app: FastAPI) -> AsyncIterator[None]:
        """Keep worker processes while the service runs."""
        for _ in range(self.settings.workers):
            self.quick_workers.append(Worker(self.settings, is_quick=True))
            self.long_workers.append(Worker(self.settings, is_quick=False))
        try:
            yield
        finally:
            for worker in self._workers:
                worker.close()
            self.lexicon.close()

    @property
    def is_warm(self) -> bool:
        """Whether every worker process has become ready, and so answers at once."""
        return all(worker.is_warm for worker in self._workers)

    async def sign(
        self, call: Request, request: wire.SentenceRequest, file: wire.AnswerFile | None, upload: bytes | None
    ) -> work.Answer:
        """Answer a sentence: at once if it is quick, else by a long job. Raises as ``run``."""
        with self.requests.hold(call):
            job = work.splice_if_quick, request, file, upload
            quick = await self.run(call, self.quick_workers, work.QUICK_SECONDS, *job)
            if isinstance(quick, work.Answer):
                return quick
            return await self.run(call, self.long_workers, quick, work.splice_glosses, request, file, upload)

    async def read_avatar(self, call: Request, file: UploadFile) -> bytes:
        """Return an uploaded avatar, as jobs take it. Raises as ``run``."""
        with self.requests.hold(call):
            job = work.pickle_avatar, safe_name(file.filename or "avatar"), await file.read()
            return await self.run(call, self.long_workers, _UPLOAD_SECONDS, *job)

    async def run(
        self, call: Request, workers: Sequence[Worker], seconds: float, job: Callable[..., ResultT], *args: object
    ) -> ResultT:
        """Run a job when it is the client's turn. Raises as ``Worker.run``, and ``ClientDisconnect``."""
        turn = self.queue.run(caller(call), workers, seconds, lambda worker: worker.run(job, *args))
        return await while_connected(call, turn)

    async def stream(self, socket: WebSocket) -> None:
        """Serve one client's stream, on the worker with the fewest streams."""
        with ExitStack() as stack:
            try:
                stack.enter_context(self.streams.hold(socket))
            except BusyError as error:
                await socket.accept()
                await socket.send_json({"type": "error", **failure(error)})
                await socket.close(TRY_AGAIN_LATER)
                return
            worker = min(self.quick_workers, key=self.n_streams.__getitem__)
            self.n_streams[worker] += 1
            stack.callback(self.n_streams.subtract, [worker])
            stack.enter_context(self.metrics.streams.track_inprogress())
            await StreamSession(socket, self.settings, self.queue, worker, self.metrics, self.avatars).run()


def create(settings: Settings, scenes: Sequence[Mapping[str, Any]] = ()) -> FastAPI:
    """Create the service as an ASGI application. ``scenes``: initial scenes of its page, as ``wire.Spliced``.

    Raises ``InputError`` if the lexicon cannot be opened or has a damaged word.
    """
    service = Service(settings, scenes)
    app = FastAPI(
        title="signsplice",
        version=version("signsplice"),
        description="Splices motion-capture clips of signed words into fluent sentences.",
        lifespan=service.lifespan,
        docs_url=None,
        redoc_url=None,
    )
    app.state.service = service
    _add_state_routes(app, service)
    _add_work_routes(app, service)
    _add_docs(app)
    _add_error_handlers(app)
    app.add_middleware(CountRequests, metrics=service.metrics)
    app.add_middleware(Limits, settings=settings)
    return app


def _add_state_routes(app: FastAPI, service: Service) -> None:
    """Add the page, and routes that describe the service."""
    pages = page.PageResponses(service.scenes, service.settings.allowed_embedders)

    @app.api_route("/", methods=["GET", "HEAD"], include_in_schema=False)
    def viewer(request: Request) -> Response:
        return pages.answer(request.headers)

    @app.head("/healthz", include_in_schema=False)
    @app.get("/healthz", response_model=wire.Health, responses={503: {"model": wire.Health}, **_failures(421)})
    async def health(answer: Response) -> wire.Health:
        """Whether the service runs, and how busy it is; 503 until its worker processes are warm."""
        status: Literal["ok", "starting"] = "ok" if service.is_warm else "starting"
        answer.status_code = 200 if service.is_warm else 503
        return wire.Health(status, app.version, len(service.lexicon), service.requests.n_held, service.streams.n_held)

    @app.head("/metrics", include_in_schema=False)
    @app.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}, **_failures(421)})
    async def metrics() -> Response:
        """Counters in Prometheus' text format."""
        return Response(service.metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    @app.head("/v1/methods", include_in_schema=False)
    @app.get("/v1/methods", responses=_failures(421))
    def methods() -> list[wire.MethodInfo]:
        """Every cutter, transition, duration rule and system."""
        return [
            wire.MethodInfo(kind, method.name, method.summary, method.learned, default)  # type: ignore[arg-type]
            for kind, method, default in all_methods()
        ]

    @app.head("/v1/avatars", include_in_schema=False)
    @app.get("/v1/avatars", responses=_failures(421))
    def avatars() -> list[str]:
        """Names of the avatars that a request may name."""
        return sorted(service.settings.avatar_files)

    @app.head("/v1/lexicon", include_in_schema=False)
    @app.get("/v1/lexicon", responses=_failures(421, 422))
    def lexicon(
        search: Annotated[
            str, Query(max_length=200, description="Only words that have this in a gloss or synonym.")
        ] = "",
        start: Annotated[int, Query(ge=0, le=10_000_000)] = 0,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    ) -> wire.WordList:
        """Words of the lexicon in order; with ``search``, those that begin with it come first."""
        matches, language_of = service.lexicon.search(search), service.lexicon.language_of
        words = [
            wire.LexiconWord(
                word.gloss, word.kind, list(word.synonyms), round(word.seconds, 3),  # type: ignore[arg-type]
                word.signer, word.checked, language_of(word.gloss),
            )
            for word in matches[start : start + limit]
        ]  # fmt: skip
        return wire.WordList(words, len(matches))


def _add_work_routes(app: FastAPI, service: Service) -> None:
    """Add routes that make animations."""
    settings = service.settings

    @app.post("/v1/sentence", response_model=wire.Spliced, responses={**_SPLICED, **_FAILURES})
    async def sentence(
        call: Request,
        request: wire.SentenceRequest,
        file: Annotated[wire.AnswerFile | None, Query(description=_ONE_FILE)] = None,
    ) -> Response:
        """Sign glosses, or a line of them as text: one animation, and the report of its seams."""
        _check_line(request, settings)
        return _response(await service.sign(call, request, file, service.avatars.content(request.avatar)))

    @app.post("/v1/fit", response_model=wire.Spliced, responses={**_SPLICED, **_FAILURES})
    async def fit(
        call: Request,
        avatar: _AvatarFile,
        options: Annotated[str, Form(description="JSON: what to sign, as of /v1/sentence.")],
        file: Annotated[wire.Format | None, Query(description="Answer with this one file instead of JSON.")] = None,
    ) -> Response:
        """Sign glosses, or a line of them as text, on an avatar that is uploaded: motion fitted to its body."""
        request = _options(_FIT_OPTIONS, options)
        _check_line(request, settings)
        if request.avatar is not None:
            raise InputError("options: an avatar is named, expected none beside the one that is uploaded")
        upload = await service.read_avatar(call, avatar)
        return _response(await service.sign(call, replace(request, avatar="upload"), file, upload))

    @app.post("/v1/avatar", responses=_FAILURES)
    async def upload_avatar(call: Request, avatar: _AvatarFile) -> wire.UploadedAvatar:
        """Upload an avatar once; requests and streams then name its id."""
        return wire.UploadedAvatar(service.avatars.add(caller(call), await service.read_avatar(call, avatar)))

    @app.post("/v1/splice", response_model=wire.Spliced, responses={**_SPLICED, **_FAILURES})
    async def splice(
        call: Request,
        files: Annotated[
            list[UploadFile],
            File(min_length=1, description=f"{join_suffixes((*WIRE_SUFFIXES, '.sigml'))}, in the order of signing."),
        ],
        options: Annotated[str, Form(description="JSON: the dials of a splice, and formats.")] = "{}",
        file: Annotated[wire.AnswerFile | None, Query(description=_ONE_FILE)] = None,
    ) -> Response:
        """Splice files in order: one animation, and the report of its seams. A single clip is returned unchanged."""
        if len(files) > settings.max_files:
            raise InputError(f"{len(files)} files, expected at most {settings.max_files}")
        request = _options(_SPLICE_OPTIONS, options)
        clips = [(safe_name(upload.filename or "clip"), await upload.read()) for upload in files]
        with service.requests.hold(call):
            job = work.splice_files, clips, request, file, service.avatars.content(request.avatar)
            return _response(await service.run(call, service.long_workers, _UPLOAD_SECONDS, *job))

    @app.websocket("/v1/stream")
    async def stream(socket: WebSocket) -> None:
        await service.stream(socket)


def _options(kind: TypeAdapter[ResultT], text: str) -> ResultT:
    """Parse the options of a form."""
    try:
        return kind.validate_json(text)
    except ValidationError as error:
        raise InputError(f"options: {first_fault(error)}") from None


def _check_line(request: wire.SentenceRequest, settings: Settings) -> None:
    """Raise ``InputError`` if glosses and text break rules that the schema cannot express."""
    if (request.glosses is None) == (request.text is None):
        raise InputError(f"{'no' if request.text is None else 'both'} glosses and text, expected one of them")
    if request.glosses is not None and len(request.glosses) > settings.max_glosses:
        raise InputError(f"{len(request.glosses)} glosses, expected at most {settings.max_glosses}")


def _response(answer: work.Answer) -> Response:
    headers = {}
    if answer.name is not None:
        name = "".join(c if (c.isascii() and c.isalnum()) or c in "-_." else "_" for c in answer.name)
        headers["Content-Disposition"] = f'attachment; filename="{name}"'
        if name != answer.name:  # RFC 6266: the name itself, for those that read it
            headers["Content-Disposition"] += f"; filename*=UTF-8''{quote(answer.name, safe='')}"
    return Response(answer.content, media_type=answer.media_type, headers=headers)


def _failures(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {status: _FAILURES[status] for status in statuses}


def _add_docs(app: FastAPI) -> None:
    """Add a page of the routes, with Swagger UI from this host: FastAPI's own page loads it from a CDN."""
    files = page.BUILT / "docs"
    if not files.is_dir():
        return
    app.mount("/docs/files", StaticFiles(directory=files), name="docs files")

    path = "/docs/files/swagger-ui"
    answer = get_swagger_ui_html(
        openapi_url="/openapi.json",
        title="signsplice",
        swagger_js_url=f"{path}-bundle.js",
        swagger_css_url=f"{path}.css",
        swagger_favicon_url="data:,",
    )
    script = bytes(answer.body).partition(b"<script>")[2].partition(b"</script>")[0]
    script_hash = base64.b64encode(hashlib.sha256(script).digest()).decode()
    answer.headers["Content-Security-Policy"] = (
        f"default-src 'none'; script-src 'self' 'sha256-{script_hash}'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )

    @app.api_route("/docs", methods=["GET", "HEAD"], include_in_schema=False)
    async def docs() -> Response:
        return answer


def _add_error_handlers(app: FastAPI) -> None:
    """Answer every failure with ``wire.Failure`` and a message of one line."""

    @app.exception_handler(SignspliceError)
    async def signsplice_error(_: Request, error: SignspliceError) -> Response:
        status = 422 if isinstance(error, InputError) else 503 if isinstance(error, BusyError) else 500
        headers = {"Retry-After": "2"} if status == 503 else {}
        return JSONResponse(failure(error), 404 if isinstance(error, MissingExtraError) else status, headers)

    @app.exception_handler(RequestValidationError)
    async def invalid_request(_: Request, error: RequestValidationError) -> Response:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        return JSONResponse({"error": f"{where}: {fault['msg']}", "unknown": {}}, 422)

    @app.exception_handler(ClientDisconnect)
    async def gone(_: Request, error: ClientDisconnect) -> Response:
        return Response(status_code=499)  # reaches nobody; the metrics count it

    @app.exception_handler(Exception)
    async def fault(_: Request, error: Exception) -> Response:
        return JSONResponse({"error": "the service failed at this; its log has the reason", "unknown": {}}, 500)

    @app.exception_handler(HTTPException)
    async def http_error(_: Request, error: HTTPException) -> Response:
        return JSONResponse({"error": str(error.detail), "unknown": {}}, error.status_code, error.headers)


def serve(
    settings: Settings, scenes: Sequence[Mapping[str, Any]] = (), on_open: Callable[[str], None] | None = None
) -> None:
    """Listen until interrupted. Calls ``on_open`` with the page's address once the socket is open.

    Raises ``InputError`` if the service cannot listen on the address or the lexicon cannot be opened.
    """
    app = create(settings, scenes)
    config = uvicorn.Config(
        app,
        http="h11",  # which limits heads, trailers and the framing of chunks
        h11_max_incomplete_event_size=settings.max_head_bytes,
        limit_concurrency=settings.max_connections,
        ws="websockets-sansio",
        ws_per_message_deflate=False,  # costs more than it saves on frames
        ws_max_size=settings.max_message_bytes,
        proxy_headers=bool(settings.proxies),
        forwarded_allow_ips=list(settings.proxies),
        timeout_graceful_shutdown=ceil(settings.drain_seconds),
        log_level="error",  # uvicorn writes a warning for every bad request: a flood would fill the log
        access_log=False,
        server_header=False,
    )
    quieten()
    with _listen(settings) as listener:
        if on_open is not None:
            host = settings.host if ":" not in settings.host else f"[{settings.host}]"
            on_open(f"http://{host}:{listener.getsockname()[1]}/")
        uvicorn.Server(config).run(sockets=[listener])


def _listen(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        listener = socket.create_server((settings.host, settings.port), family=family, backlog=512)
    except OSError as error:
        number = error.errno or 0
        if number < 0 or number == errno.EADDRNOTAVAIL:  # below zero: the name was not found
            advice = "name one, e.g. 127.0.0.1 or 0.0.0.0"
            raise InputError(f"cannot listen: host {settings.host} is no address of this machine; {advice}") from error
        reason = os.strerror(number)  # the error's own repeats the address
        raise InputError(f"cannot listen on {settings.host}:{settings.port} ({reason}); try another port") from error
    # Connections inherit these. Small buffers interleave floods with other connections, and show what is not read.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BYTES)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux closes connections whose client reads nothing for so long
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, ceil(1000 * settings.idle_seconds))
    return listener
