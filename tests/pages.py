"""Pages that speak viser's websocket and draw nothing, and an explorer on a real server that a test ticks."""

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import Any

import msgspec
import pytest
import viser
import zstandard
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from flutterviz.app import Explorer
from flutterviz.clock import FRAME
from flutterviz.jobs import Job
from flutterviz.rig import Rig, rig_of
from flutterviz.session import Session
from solver import Design, load_design

DESIGN = load_design("seed-840").with_reduction("patched", 8)  # quick to rebuild; the page does not know the modes


class Page:
    """What a browser is to the server: a camera, clicks, widgets and keys, and the messages that come back."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.server = server
        protocol = Subprotocol(f"viser-v{viser.__version__}")
        self.socket = connect(
            f"ws://127.0.0.1:{server.get_port()}", subprotocols=[protocol], max_size=None, max_queue=None
        )
        pose: dict[str, Any] = {"wxyz": (1, 0, 0, 0), "position": (0, 0, 3), "look_at": (0, 0, 0)}
        lens = {"fov": 0.7, "near": 0.05, "far": 20.0, "image_height": 700, "image_width": 1000}
        self.send("ViewerCameraMessage", **pose, **lens, up_direction=(0, 1, 0))

    def send(self, kind: str, **fields: object) -> None:
        self.socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def update(self, handle: Any, value: object) -> None:  # noqa: ANN401 - any of viser's handles
        self.send("GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})

    def key(self, label: str) -> None:
        commands = self.server.gui._command_handle_from_uuid
        self.send("CommandTriggerMessage", uuid=next(u for u, c in commands.items() if c.label == label))

    def click(self, x: float, y: float) -> None:
        """Click on the panel, seen from straight above, at a place in scene units."""
        ray = {"ray_origin": (x, y, 3.0), "ray_direction": (0.0, 0.0, -1.0)}
        self.send("ScenePointerMessage", event_type="click", **ray, screen_pos=((0.5, 0.5),), modifier=None)

    def received(self) -> list[dict[str, Any]]:
        """The messages that have come in since the last call."""
        messages: list[dict[str, Any]] = []
        while True:
            try:
                data = self.socket.recv(timeout=0.2)
            except TimeoutError:
                return messages
            assert isinstance(data, bytes)
            size = int.from_bytes(data[8:16], "little")  # viser: two lengths, compressed msgpack, then raw arrays
            text = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
            messages += msgspec.msgpack.decode(text, strict=False)["messages"]

    def writes_to(self, handle: Any) -> list[object]:  # noqa: ANN401 - as above
        """Values of a widget that came in since the last call."""
        mine = [m for m in self.received() if m["type"] == "GuiUpdateMessage" and m["uuid"] == handle._impl.uuid]
        return [m["updates"]["value"] for m in mine if "value" in m["updates"]]

    def close(self) -> None:
        self.socket.close()


@cache
def rig() -> Rig:
    return rig_of(DESIGN)


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def explorer_on(server: viser.ViserServer, job: Job | None = None) -> Explorer:
    """An explorer whose rigs and maps are made by threads, which are there at once, where processes first import."""
    threads = (ThreadPoolExecutor(1), ThreadPoolExecutor(1))
    return Explorer(Session(DESIGN, rig()), server, job=job, builder=threads[0], looker=threads[1])


@pytest.fixture
def explorer(server: viser.ViserServer) -> Iterator[Explorer]:
    explorer = explorer_on(server)
    yield explorer
    explorer.close()


@pytest.fixture
def page(explorer: Explorer) -> Iterator[Page]:
    page = Page(explorer.server)
    until(explorer, lambda: len(explorer.server.get_clients()) == 1)
    yield page
    page.close()


def ticks(explorer: Explorer, count: int) -> None:
    for _ in range(count):
        explorer.tick()
        time.sleep(FRAME)


def until(explorer: Explorer, condition: Callable[[], bool]) -> None:
    """Tick until something holds; a busy machine may take its time."""
    end = time.perf_counter() + 30
    while not condition():
        assert time.perf_counter() < end, "it never came about"
        ticks(explorer, 1)


def status(explorer: Explorer) -> str:
    return explorer.controls._status.content


def refreshed(explorer: Explorer) -> str:
    """The status after the page was certainly written again."""
    ticks(explorer, 10)
    return status(explorer)


def centre(element: int) -> tuple[float, float]:
    """Middle of an element [scene units] on the square panel, whose side is 1."""
    i, j = divmod(element, DESIGN.mesh.ny)
    return (i + 0.5) / DESIGN.mesh.nx, (j + 0.5) / DESIGN.mesh.ny


@contextmanager
def served(design: Design) -> Iterator[Explorer]:
    """An explorer on a port of its own, its loop in a thread."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    explorer = Explorer(Session(design), server)
    loop = threading.Thread(target=explorer.run)
    loop.start()
    yield explorer
    explorer.running = False
    loop.join()
    explorer.close()
    server.stop()
