"""The service's routes: thin skins over the engine, which works in processes of its own."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Annotated, Any

from fastapi import FastAPI, File, Form, Query, Request, UploadFile, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.openapi.docs import get_swagger_ui_html
from pydantic import TypeAdapter, ValidationError
from starlette.exceptions import HTTPException
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from signsplice.errors import InputError, MissingExtraError, SignspliceError
from signsplice.service import page, work
from signsplice.service.limits import Limits
from signsplice.service.metrics import Counting, Metrics
from signsplice.service.scene import safe_name
from signsplice.service.settings import Settings
from signsplice.service.streaming import AGAIN, StreamSession, failure, message
from signsplice.service.wire import (
    Failure,
    Format,
    Health,
    LexiconWord,
    MethodInfo,
    SentenceRequest,
    Spliced,
    SpliceRequest,
    WordList,
)
from signsplice.service.workers import BusyError, WorkerProcess, Workers
from signsplice.splicing import methods as defaults

_OPTIONS: TypeAdapter[SpliceRequest] = TypeAdapter(SpliceRequest)
_FAILURES: dict[int | str, dict[str, Any]] = {
    status: {"model": Failure, "description": why}
    for status, why in (
        (400, "The body is not sound."),
        (403, "A page of another origin calls."),
        (408, "The body comes too slowly."),
        (413, "The body is too long."),
        (415, "The body is compressed."),
        (421, "The service is called by a name that is not its own."),
        (422, "The request cannot be done: what, where, and what to do."),
        (503, "Too much to do; try again in a moment."),
    )
}
_RAW: dict[int | str, dict[str, Any]] = {
    200: {"content": {"text/plain": {}, "model/gltf-binary": {}}, "description": "A splice, or one file of it."}
}


class Service:
    """What the routes share."""

    def __init__(self, settings: Settings, scenes: Sequence[Mapping[str, Any]]) -> None:
        self.settings, self.scenes = settings, scenes
        self.lexicon = work.open_words(settings)
        self.requests: Workers
        self.streamers: Workers
        self.load: dict[WorkerProcess, int] = {}
        self.metrics = Metrics(lambda: self.requests.waiting, lambda: self.requests.n_lost + self.streamers.n_lost)

    @asynccontextmanager
    async def lifespan(self, app: FastAPI) -> AsyncIterator[None]:
        """Worker processes, as long as the service runs."""
        self.requests = Workers(self.settings, self.settings.workers, skin=True)
        self.streamers = Workers(self.settings, self.settings.workers)
        try:
            yield
        finally:
            self.requests.close()
            self.streamers.close()
            self.lexicon.close()

    async def stream(self, socket: WebSocket) -> None:
        """One client's stream, on the worker that has the fewest."""
        if sum(self.load.values()) >= self.settings.max_streams:
            await socket.accept()
            await socket.send_json({"type": "error", "error": "too many streams; try again in a moment", "unknown": {}})
            await socket.close(AGAIN)
            return
        worker = self.streamers.pick(lambda one: self.load.get(one, 0))
        self.load[worker] = self.load.get(worker, 0) + 1
        self.metrics.streams.inc()
        try:
            await StreamSession(socket, self.settings, worker, self.metrics).run()
        finally:
            self.load[worker] -= 1
            self.metrics.streams.dec()


def create(settings: Settings, scenes: Sequence[Mapping[str, Any]] = ()) -> FastAPI:
    """The service as an ASGI application; ``scenes``: what its page shows at first. Raises ``InputError`` for a
    lexicon that cannot be opened.
    """
    service = Service(settings, scenes)
    app = FastAPI(
        title="signsplice",
        version=version("signsplice"),
        description="Joins motion-capture clips of signed words into fluent sentences.",
        lifespan=service.lifespan,
        docs_url=None,
        redoc_url=None,
    )
    _add_state_routes(app, service)
    _add_work_routes(app, service)
    _docs(app)
    _errors(app)
    app.add_middleware(Counting, metrics=service.metrics)
    if settings.allowed_origins:
        app.add_middleware(
            CORSMiddleware, allow_origins=settings.allowed_origins, allow_methods=["GET", "POST"], allow_headers=["*"]
        )
    app.add_middleware(Limits, settings=settings)
    return app


def _add_state_routes(app: FastAPI, service: Service) -> None:
    """The page, and routes that tell what there is."""

    @app.get("/", include_in_schema=False)
    async def viewer() -> Response:
        shown = page.html(service.scenes, live=True)
        return HTMLResponse(shown, headers={"X-Frame-Options": "DENY", "Cache-Control": "no-cache"})

    @app.get("/healthz", response_model=Health, responses=_some(421))
    async def health() -> Health:
        """Whether the service is there, and how busy it is."""
        return Health("ok", app.version, len(service.lexicon), service.requests.waiting, sum(service.load.values()))

    @app.get("/metrics", response_class=Response, responses={200: {"content": {"text/plain": {}}}, **_some(421)})
    async def metrics() -> Response:
        """Counters in Prometheus' text format."""
        return Response(service.metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    @app.get("/v1/methods", responses=_some(421))
    def methods() -> list[MethodInfo]:
        """Every cutter, transition and duration by name."""
        return [
            MethodInfo(kind, part.name, part.summary, part.learned, default)  # type: ignore[arg-type]
            for kind, part, default in defaults.all_methods()
        ]

    @app.get("/v1/lexicon", responses=_some(421, 422))
    def lexicon(
        search: Annotated[str, Query(max_length=200, description="Only words with this in their gloss.")] = "",
        start: Annotated[int, Query(ge=0, le=10_000_000)] = 0,
        limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    ) -> WordList:
        """Words of the lexicon in order; those that begin with what is searched come first."""
        found = service.lexicon.search(search)
        words = [
            LexiconWord(e.gloss, e.kind, list(e.synonyms), round(e.seconds, 3), e.signer, e.checked)  # type: ignore[arg-type]
            for e in found[start : start + limit]
        ]
        return WordList(words, len(found))


def _add_work_routes(app: FastAPI, service: Service) -> None:
    """Routes that make animations."""
    settings = service.settings

    @app.post("/v1/sentence", response_model=Spliced, responses={**_RAW, **_FAILURES})
    async def sentence(
        request: SentenceRequest,
        file: Annotated[Format | None, Query(description="Answer with this one file, not with JSON.")] = None,
    ) -> Response:
        """Glosses in the order of signing -> one animation, and the report of its seams."""
        if len(request.glosses) > settings.max_glosses:
            raise InputError(f"{len(request.glosses)} glosses, expected at most {settings.max_glosses}")
        return _response(await service.requests.run(work.sign, request, file))

    @app.post("/v1/splice", response_model=Spliced, responses={**_RAW, **_FAILURES})
    async def splice(
        files: Annotated[
            list[UploadFile], File(min_length=1, description=".bvh, .glb or .vrma, in the order of signing.")
        ],
        options: Annotated[str, Form(description="JSON: the dials of a splice, and formats.")] = "{}",
        file: Annotated[Format | None, Query(description="Answer with this one file, not with JSON.")] = None,
    ) -> Response:
        """Clips in order -> one animation, and the report of its seams. One clip is brought in and shown as it is."""
        if len(files) > settings.max_files:
            raise InputError(f"{len(files)} files, expected at most {settings.max_files}")
        try:
            asked = _OPTIONS.validate_json(options)
        except ValidationError as error:
            raise InputError(f"options: {message(error)}") from None
        clips = [(safe_name(one.filename or "clip"), await one.read()) for one in files]
        return _response(await service.requests.run(work.join, clips, asked, file))

    @app.websocket("/v1/stream")
    async def stream(socket: WebSocket) -> None:
        await service.stream(socket)


def _response(answer: work.Answer) -> Response:
    headers = {}
    if answer.name is not None:
        plain = "".join(c if (c.isascii() and c.isalnum()) or c in "-_." else "_" for c in answer.name)
        headers["Content-Disposition"] = f'attachment; filename="{plain}"'
    return Response(answer.content, media_type=answer.media_type, headers=headers)


def _some(*statuses: int) -> dict[int | str, dict[str, Any]]:
    return {status: _FAILURES[status] for status in statuses}


def _docs(app: FastAPI) -> None:
    """A page of the routes that needs no other host."""
    built = page.BUILT / "docs"
    if not built.is_dir():
        return
    app.mount("/docs/files", StaticFiles(directory=built), name="docs files")

    @app.get("/docs", include_in_schema=False)
    async def docs() -> Response:
        at = "/docs/files/swagger-ui"
        return get_swagger_ui_html(
            openapi_url="/openapi.json",
            title="signsplice",
            swagger_js_url=f"{at}-bundle.js",
            swagger_css_url=f"{at}.css",
            swagger_favicon_url="data:,",
        )


def _errors(app: FastAPI) -> None:
    """Every failure as one line of JSON."""

    @app.exception_handler(SignspliceError)
    async def wrong(_: Request, error: SignspliceError) -> Response:
        status = 422 if isinstance(error, InputError) else 503 if isinstance(error, BusyError) else 500
        headers = {"Retry-After": "2"} if status == 503 else {}
        return JSONResponse(failure(error), 404 if isinstance(error, MissingExtraError) else status, headers)

    @app.exception_handler(RequestValidationError)
    async def malformed(_: Request, error: RequestValidationError) -> Response:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        return JSONResponse({"error": f"{where}: {first['msg']}", "unknown": {}}, 422)

    @app.exception_handler(HTTPException)
    async def refused(_: Request, error: HTTPException) -> Response:
        return JSONResponse({"error": str(error.detail), "unknown": {}}, error.status_code, error.headers)
