"""Owns the servers whose page is measured, in a process each, and the reader in another that takes in what they send.

The reader unpacks all that a browser would, and draws nothing: a browser that draws by software fills both cores of a
small machine, and then it is measured, and not the server.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import msgspec
import numpy as np
import rich
import trimesh
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from flutterviz import colormap
from flutterviz import commands as do
from flutterviz.app import Explorer
from flutterviz.beside import Beside
from flutterviz.clock import FRAME
from flutterviz.finder import CancelSearch, StartSearch
from flutterviz.rig import Rig, in_flutter, rig_of
from flutterviz.scene import Scene
from flutterviz.session import Session
from flutterviz.surface import DisplayGrid, to_trimesh
from solver import Design, load_design
from solver.mesh import Floats

DESIGN = "seed-840"
TURNS = 4  # into which a time is divided, to see how much they differ
PICTURES = 48  # of a period, drawn again and again
TOGGLES = (0.33, 0.5)  # s between two
IN_PLACE = 20  # rigs built in place, for comparison
HEIGHT = 0.083  # of 1 h in the scene, as the explorer draws it at first [scene units]
PATIENCE = 120.0  # s for a page to appear and a rig to be built; a busy machine may take its time


@dataclass(frozen=True)
class Arrival:
    """A message of the server's, as the reader got it."""

    time: float
    """When, by the clock that all processes share [s]."""
    size: int
    """Its length [bytes]."""
    picture: bool
    """Whether the panel is in it."""


@dataclass(frozen=True)
class Stretch:
    """A time in which one thing was done."""

    name: str
    """What."""
    begin: float
    """From when on [s]."""
    end: float
    """Until when [s]."""
    processor: float
    """Processor time of the server's process, all of its threads together [s]."""
    pictures: tuple[float, ...]
    """When each picture left the loop [s]."""
    clicks: tuple[float, ...] = ()
    """Time from each click until the rig that came of it is the one that moves [s]."""


@dataclass(frozen=True)
class Report:
    """What a server and its reader have seen."""

    stretches: tuple[Stretch, ...]
    """One after the other."""
    arrivals: tuple[Arrival, ...]
    """All messages, those between the stretches too."""
    in_place: tuple[float, ...] = ()
    """Building some of the clicked rigs in the server's own process, where nothing else goes on [s]."""

    def named(self, name: str) -> list[Stretch]:
        """The stretches of one name."""
        return [stretch for stretch in self.stretches if stretch.name == name]

    def arrived(self, stretch: Stretch) -> list[Arrival]:
        """What came in during a stretch."""
        return [arrival for arrival in self.arrivals if stretch.begin <= arrival.time <= stretch.end]


def stream_report(seconds: float) -> Report:
    """The moving panel alone: in turns `ours`, as the explorer draws it, and `plain`, as a mesh of viser's own."""
    design = load_design(DESIGN)
    rig = rig_of(design)
    states, _ = rig.loop.stretch(in_flutter(rig), rig.plant.period / PICTURES, PICTURES, engaged=False)
    shapes = [rig.displacement(state) / rig.thickness for state in states]
    stretches: list[Stretch] = []
    with _server() as (server, arrivals):
        _until(lambda: bool(server.get_clients()))
        scene = Scene(server, rig, design.patches.elements)
        ways = (("ours", lambda w: scene.show(w, rig.thickness)), ("plain", _plain(server, rig.grid, scene)))
        for name, show in itertools.islice(itertools.cycle(ways), 2 * TURNS):
            _drawn(name, show, shapes, 10 * FRAME)  # what is laid out once is not measured
            stretches.append(_drawn(name, show, shapes, seconds / TURNS))
    return Report(tuple(stretches), tuple(arrivals))


def explorer_report(seconds: float) -> Report:
    """The explorer, at rest and toggled at random, alone and beside a search: a stretch each."""
    with _server() as (server, arrivals), ThreadPoolExecutor(1) as thread:
        explorer = Explorer(Session(load_design(DESIGN)), server)
        watch = _Watch(explorer)

        def steer() -> None:
            try:
                _until(lambda: bool(server.get_clients()))
                watch.stretch("warming up", 2 * TOGGLES[1], toggling=True)
                _until(lambda: explorer.outlook is not None)
                for _ in range(TURNS):
                    watch.stretch("rest", seconds / TURNS)
                watch.stretch("toggling", seconds, toggling=True)
                explorer.ask(StartSearch())
                _until(lambda: explorer.finder.found is not None)
                watch.stretch("rest beside a search", seconds, searching=True)
                watch.stretch("toggling beside a search", seconds, toggling=True, searching=True)
                explorer.ask(CancelSearch())
            finally:
                explorer.running = False

        steering = thread.submit(steer)
        explorer.run()
        explorer.close()
        steering.result()
    rig, times = explorer.session.rig, []
    for design in watch.wanted[:IN_PLACE]:
        begin = time.perf_counter()
        rig = rig_of(design, rig, complete=False)  # as a click has it built
        times.append(time.perf_counter() - begin)
    return Report(tuple(watch.stretches), tuple(arrivals), tuple(times[1:]))


class _Watch:
    """Clicks on an explorer, from another thread than its loop's, and notes what comes of it and when."""

    def __init__(self, explorer: Explorer) -> None:
        self.stretches: list[Stretch] = []
        self.wanted: list[Design] = []
        self._explorer = explorer
        self._pictures: list[float] = []
        self._open: deque[tuple[tuple[int, ...], float]] = deque()  # layouts to come, and when they were clicked
        self._latencies: list[float] = []
        self._rng = np.random.default_rng(0)
        show, adopt = explorer.scene.show, explorer.session.adopt

        def shown(w_over_h: Floats, thickness: float) -> None:
            show(w_over_h, thickness)
            self._pictures.append(time.perf_counter())

        def adopted(rig: Rig, start: Floats | None = None) -> None:
            adopt(rig, start)
            now, layouts = time.perf_counter(), [layout for layout, _ in tuple(self._open)]
            if rig.design.patches.elements in layouts:  # with it, the clicks that came before and were not built alone
                for _ in range(layouts.index(rig.design.patches.elements) + 1):
                    self._latencies.append(now - self._open.popleft()[1])

        explorer.scene.show, explorer.session.adopt = shown, adopted

    def stretch(self, name: str, seconds: float, toggling: bool = False, searching: bool = False) -> None:
        """Let it run for a time, an element toggled now and then, and a search under way again where one ends."""
        explorer, mesh = self._explorer, self._explorer.session.design.mesh
        self._pictures.clear()
        self._latencies.clear()
        begin, busy = time.perf_counter(), time.process_time()
        while time.perf_counter() < begin + seconds:
            if toggling:
                self._click(int(self._rng.integers(mesh.nx * mesh.ny)))
            if searching and explorer.finder.phase != "running":
                explorer.ask(StartSearch())
            time.sleep(self._rng.uniform(*TOGGLES))
        _until(lambda: not self._open)
        end, busy = time.perf_counter(), time.process_time() - busy
        self.stretches.append(Stretch(name, begin, end, busy, tuple(self._pictures), tuple(self._latencies)))

    def _click(self, element: int) -> None:
        wanted = self.wanted[-1] if self.wanted else self._explorer.session.design
        self.wanted.append(wanted.with_elements(tuple(set(wanted.patches.elements) ^ {element})))
        self._open.append((self.wanted[-1].patches.elements, time.perf_counter()))
        self._explorer.ask(do.TogglePatch(element))


@contextmanager
def _server() -> Iterator[tuple[viser.ViserServer, list[Arrival]]]:
    """A server with a reader on its page; what that has read is in the list in the end."""
    rich.get_console().quiet = True  # on which viser says where it serves
    arrivals: list[Arrival] = []
    # a server's events go to the terminal, where a benchmark has its own to say
    with contextlib.redirect_stdout(io.StringIO()), contextlib.ExitStack() as ending:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        beside = Beside()
        ending.callback(beside.shutdown)
        reading = beside.submit(read, server.get_port())
        try:
            yield server, arrivals
        finally:
            server.stop()
        arrivals += reading.result(PATIENCE)


def read(port: int) -> list[Arrival]:
    """Everything that a server sends to a page until it stops; in another process."""
    unzip, arrivals = zstandard.ZstdDecompressor(), []
    protocol = Subprotocol(f"viser-v{version('viser')}")
    pose = {"wxyz": (1, 0, 0, 0), "position": (0, 0, 3), "look_at": (0, 0, 0), "up_direction": (0, 1, 0)}
    lens = {"fov": 0.7, "near": 0.05, "far": 20.0, "image_height": 900, "image_width": 1440}
    address = f"ws://127.0.0.1:{port}"
    with connect(address, subprotocols=[protocol], max_size=None, max_queue=None, compression=None) as socket:
        socket.send(msgspec.msgpack.encode({"type": "ViewerCameraMessage", **pose, **lens}))
        with contextlib.suppress(ConnectionClosed):
            while True:
                data = socket.recv()
                assert isinstance(data, bytes)
                size = int.from_bytes(data[8:16], "little")  # viser: two lengths, compressed msgpack, then raw arrays
                messages = msgspec.msgpack.decode(unzip.decompress(data[16 : 16 + size]), strict=False)["messages"]
                picture = any(_has_panel(message) for message in messages)
                arrivals.append(Arrival(time.perf_counter(), len(data), picture))
    return arrivals


def _has_panel(message: dict[str, Any]) -> bool:
    changed = message.get("updates") or message.get("props") or {}
    return message.get("name") in ("/panel", "/plain") and "glb_data" in changed


def _drawn(name: str, show: Callable[[Floats], None], shapes: list[Floats], seconds: float) -> Stretch:
    """Pictures at the explorer's rate, of shapes (nvx, nvy) w/h in turn."""
    begin, busy, pictures = time.perf_counter(), time.process_time(), []
    for shape in itertools.cycle(shapes):
        show(shape)
        pictures.append(time.perf_counter())
        time.sleep(max(0.0, begin + len(pictures) * FRAME - time.perf_counter()))
        if time.perf_counter() > begin + seconds:
            break
    return Stretch(name, begin, time.perf_counter(), time.process_time() - busy, tuple(pictures))


def _plain(server: viser.ViserServer, grid: DisplayGrid, scene: Scene) -> Callable[[Floats], None]:
    """The same surface in the same colours as viser's documentation would have it: a mesh that is added anew."""
    rest = to_trimesh(grid, np.zeros(grid.shape), np.zeros(grid.shape))
    vertices, faces = rest.vertices.copy(), rest.faces

    def show(w_over_h: Floats) -> None:
        vertices[:, 2] = (w_over_h * HEIGHT).ravel()
        colours = colormap.display_rgb(w_over_h.ravel() / scene.limit)
        server.scene.add_mesh_trimesh("/plain", trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False))

    return show


def _until(condition: Callable[[], bool]) -> None:
    """Wait until something holds.

    Raises:
        TimeoutError: it never came about.
    """
    end = time.perf_counter() + PATIENCE
    while not condition():
        if time.perf_counter() > end:
            raise TimeoutError("the page that is measured does not answer")
        time.sleep(0.02)
