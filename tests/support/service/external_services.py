"""Services beside ours: an S3 object store and a collector of traces.

An S3 object store for tests: ``python -m support.service.external_services PORT FOLDER``.

Objects are files ``FOLDER/BUCKET/KEY``; parts of uploads that are not complete yet lie in ``FOLDER/.parts``. Requests
must be signed, but signatures are not checked. A real store answered the same tests in the same way (docs/chaos.md).

A collector of OpenTelemetry traces on loopback.
"""

import hashlib
import re
import shutil
import sys
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import parse_qs, unquote, urlsplit
from xml.etree import ElementTree
from xml.sax.saxutils import escape

from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opentelemetry.proto.trace.v1.trace_pb2 import Span

BUCKET = "lab"
ADDRESS = f"s3://{BUCKET}/data"
OPTIONS = {"access_key_id": "key", "secret_access_key": "secret", "region": "us-east-1"}


class ObjectStoreHandler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    folder: Path

    def do_PUT(self) -> None:
        content = self._body()
        if content is None:
            return
        part = self._query.get("partNumber")
        path = self._parts / f"{int(part[0]):05d}" if part else self._object
        self._store(path, content)
        self._answer(200, etag=hashlib.md5(content, usedforsecurity=False).hexdigest())

    def do_POST(self) -> None:
        content = self._body()
        if content is None:
            return
        if "delete" in self._query:
            keys = [key.text or "" for key in ElementTree.fromstring(content).iter() if key.tag.endswith("Key")]
            for key in keys:
                self._remove(self._bucket / key)
            self._xml("DeleteResult", "".join(f"<Deleted><Key>{escape(key)}</Key></Deleted>" for key in keys))
        elif "uploads" in self._query:
            number = uuid.uuid4().hex
            (self.folder / ".parts" / number).mkdir(parents=True)
            about = f"<Bucket>{BUCKET}</Bucket><Key>{escape(self._key)}</Key><UploadId>{number}</UploadId>"
            self._xml("InitiateMultipartUploadResult", about)
        else:
            whole = b"".join(part.read_bytes() for part in sorted(self._parts.iterdir()))
            self._store(self._object, whole)
            shutil.rmtree(self._parts)
            self._xml("CompleteMultipartUploadResult", f'<Key>{escape(self._key)}</Key><ETag>"whole"</ETag>')

    def do_GET(self) -> None:
        if not self._key:
            self._list()
        elif self._object.is_file():
            content = self._object.read_bytes()
            byte_range = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
            if byte_range is None:
                self._answer(200, content, path=self._object)
            else:
                first, last = int(byte_range[1]), min(int(byte_range[2] or len(content)), len(content) - 1)
                place = f"bytes {first}-{last}/{len(content)}"
                self._answer(206, content[first : last + 1], path=self._object, place=place)
        else:
            self._answer(404, b"<Error><Code>NoSuchKey</Code></Error>")

    do_HEAD = do_GET

    def do_DELETE(self) -> None:
        if "uploadId" in self._query:
            shutil.rmtree(self._parts, ignore_errors=True)
        else:
            self._remove(self._object)
        self._answer(204)

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    @property
    def _query(self) -> dict[str, list[str]]:
        return parse_qs(urlsplit(self.path).query, keep_blank_values=True)

    @property
    def _key(self) -> str:
        return unquote(urlsplit(self.path).path).removeprefix(f"/{BUCKET}").strip("/")

    @property
    def _bucket(self) -> Path:
        return self.folder / BUCKET

    @property
    def _object(self) -> Path:
        return self._bucket / self._key

    @property
    def _parts(self) -> Path:
        return self.folder / ".parts" / self._query["uploadId"][0]

    def _body(self) -> bytes | None:
        """Body of the request; None, after a refusal, if it is not signed."""
        content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if not self.headers.get("Authorization", "").startswith("AWS4-HMAC-SHA256 "):
            self._answer(403, b"<Error><Code>AccessDenied</Code></Error>")
            return None
        return content

    def _store(self, path: Path, content: bytes) -> None:
        """Whole or not at all, as an object store does it."""
        path.parent.mkdir(parents=True, exist_ok=True)
        part = self.folder / ".parts" / uuid.uuid4().hex
        part.parent.mkdir(exist_ok=True)
        part.write_bytes(content)
        part.replace(path)

    def _remove(self, path: Path) -> None:
        path.unlink(missing_ok=True)

    def _list(self) -> None:
        prefix = self._query.get("prefix", [""])[0]
        files = sorted(path for path in self._bucket.rglob("*") if path.is_file()) if self._bucket.exists() else []
        keys = {str(path.relative_to(self._bucket)): path for path in files}
        after, limit = self._query.get("continuation-token", [""])[0], int(self._query.get("max-keys", ["1000"])[0])
        there = [key for key in sorted(keys) if key.startswith(prefix) and key > after]
        listed = there[:limit]
        more = f"<NextContinuationToken>{escape(listed[-1])}</NextContinuationToken>" if len(there) > limit else ""
        items = "".join(self._item(key, keys[key]) for key in listed)
        self._xml(
            "ListBucketResult",
            f"<Name>{BUCKET}</Name><KeyCount>{len(listed)}</KeyCount>{more}"
            f"<IsTruncated>{'true' if more else 'false'}</IsTruncated>{items}",
        )

    @staticmethod
    def _item(key: str, path: Path) -> str:
        about = path.stat()
        written = datetime.fromtimestamp(about.st_mtime, UTC).strftime("%Y-%m-%dT%H:%M:%S.000Z")
        return (
            f"<Contents><Key>{escape(key)}</Key><Size>{about.st_size}</Size><ETag>e</ETag>"
            f"<LastModified>{written}</LastModified></Contents>"
        )

    def _xml(self, root: str, inside: str) -> None:
        self._answer(200, f'<?xml version="1.0" encoding="UTF-8"?><{root}>{inside}</{root}>'.encode())

    def _answer(
        self, status: int, content: bytes = b"", *, etag: str = "e", path: Path | None = None, place: str = ""
    ) -> None:
        self.send_response(status)
        self.send_header("ETag", f'"{etag}"')
        self.send_header("Content-Length", str(len(content)))
        if path is not None:
            self.send_header("Last-Modified", formatdate(path.stat().st_mtime, usegmt=True))
        if place:
            self.send_header("Content-Range", place)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)


class _Server(ThreadingHTTPServer):
    request_queue_size = 1024  # who is not let in at once asks again only after seconds


def server_on(port: int, folder: Path) -> ThreadingHTTPServer:
    """A server on loopback that keeps its objects in ``folder``."""
    handler = type("Handler", (ObjectStoreHandler,), {"folder": folder})
    return _Server(("127.0.0.1", port), handler)


@contextmanager
def object_store(folder: Path) -> Iterator[dict[str, str]]:
    """The options with which ``BlobStore.from_url`` reaches a store that is there meanwhile."""
    server = server_on(0, folder)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield OPTIONS | {"endpoint": f"http://127.0.0.1:{server.server_port}"}
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


__all__ = ["Collector", "Span", "collector", "span_attributes"]


@dataclass
class Collector:
    """Spans that a collector received, by the name of their service."""

    url: str
    spans: list[tuple[str, Span]] = field(default_factory=list)

    def named(self, name: str) -> list[Span]:
        return [span for _, span in self.spans if span.name == name]


@contextmanager
def collector() -> Iterator[Collector]:
    """A collector on loopback."""
    heard = Collector("")

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            assert self.path == "/v1/traces"
            export = ExportTraceServiceRequest.FromString(self.rfile.read(int(self.headers["Content-Length"])))
            for group in export.resource_spans:
                (service,) = (one.value.string_value for one in group.resource.attributes if one.key == "service.name")
                heard.spans += [(service, span) for scope in group.scope_spans for span in scope.spans]
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    heard.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield heard
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def span_attributes(span: Span) -> dict[str, str | int]:
    """The attributes of a span."""
    return {one.key: one.value.string_value or one.value.int_value for one in span.attributes}


if __name__ == "__main__":
    server_on(int(sys.argv[1]), Path(sys.argv[2])).serve_forever()
