"""ROS bags: topics and messages of ROS 1 files (.bag), ROS 2 folders, and single .mcap and .db3 files.

`rosbags` reads them without ROS (extra `ros`). Every bag that it cannot read is a UserError of one line.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from slamgauge.arrays import Int
from slamgauge.compare.storage.files import read_text
from slamgauge.errors import UserError
from slamgauge.suggestions import did_you_mean

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

NANOSECOND = np.float64(1e-9)  # s
TREES = ("/tf", "/tf_static")  # topics that are read as observations only if they are named


@dataclass(frozen=True)
class Bag:
    """An open bag.

    Attributes:
        path: the bag, for messages.
        reader: of rosbags.
        topics: type and number of messages of each topic; a topic with several types has the type `several`.
    """

    path: Path
    reader: AnyReader
    topics: dict[str, tuple[str, int]]

    def of_types(self, types: Collection[str]) -> list[str]:
        """Return the topics that have one of the types and at least one message."""
        topics = self.topics.items()
        return [name for name, (kind, count) in topics if kind in types and count and name not in TREES]

    def topic_of(self, types: Collection[str], key: str, stated: str | None = None) -> str:
        """Return a stated topic, or the only one with one of the types; raise UserError if none or several fit."""
        found = self.of_types(types)
        if stated is None and len(found) != 1:
            what = f"several topics fit ({', '.join(found)})" if found else "no topic has a known type"
            raise UserError(f"{self.path}: {what}; give --set {key}=TOPIC, `--list` lists all topics")
        topic = stated or found[0]
        if self.type_of(topic) not in types:
            remedy = did_you_mean(self.type_of(topic), types)
            raise UserError(f"{self.path}: {key}: {topic} has the type {self.type_of(topic)}; {remedy}")
        return topic

    def type_of(self, topic: str) -> str:
        """Return the type of a topic; raise UserError if the bag does not have it."""
        if topic not in self.topics:
            remedy = did_you_mean(topic, self.topics, "`slamgauge import bag PATH --list` lists all topics")
            raise UserError(f"{self.path}: has no topic {topic}; {remedy}")
        return self.topics[topic][0]

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield time of recording [ns] and content of the messages of a topic, in the order of recording."""
        kind, count = self.topics[topic]
        connections = [each for each in self.reader.connections if each.topic == topic]
        if count and kind not in self.reader.typestore.fielddefs:
            what = f"{topic}: the bag has no definition of {kind}"
            raise UserError(f"{self.path}: {what}; give the folder of its .msg files: --msgs FOLDER")
        read = 0
        with _of_library(self.path):
            for connection, received, raw in self.reader.messages(connections):
                read += 1
                yield received, self.reader.deserialize(raw, connection.msgtype)
        if read != count:
            what = f"{read} of {count} messages of {topic} are in it: it is cut"
            raise UserError(f"{self.path}: {what}; copy it again, or repair its metadata with `ros2 bag reindex`")

    def in_order(self, topic: str, times: Sequence[tuple[int, int]], notes: list[str]) -> tuple[Int, Int]:
        """Return the sorted stamps (n,) [ns] of a topic, and the order (n,) that sorts it; add notes.

        `times` are n stamps in headers, 0 without one, and times of recording [ns]. Topics without stamps have these.
        """
        stamps, received = np.array(times, dtype=np.int64).reshape(-1, 2).T
        if len(stamps) and not stamps.any():
            notes.append(f"{self.path}: {topic}: no stamps in its headers; times of recording are used")
            stamps = received
        order = np.argsort(stamps, kind="stable")
        return stamps[order], order


def header_stamp(content: Any) -> int:
    """Return the stamp [ns] in the header of a message, 0 without one."""
    header = getattr(content, "header", None)
    return 0 if header is None else 1_000_000_000 * header.stamp.sec + header.stamp.nanosec


def frame_of(content: Any) -> str:
    """Return the frame in the header of a message, "" without one. ROS 1 permits a slash in front, which is dropped."""
    return getattr(getattr(content, "header", None), "frame_id", "").removeprefix("/")


@contextmanager
def opened(path: Path, msgs: Sequence[Path] = ()) -> Generator[Bag]:
    """Open a bag.

    Args:
        path: a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.
        msgs: folders with .msg files of types that the bag does not define.

    Raises:
        UserError: the file is missing, cut or of another kind, here and while its messages are read.
    """
    if path.suffix in (".bz2", ".gz", ".xz", ".zst", ".zip", ".tar"):
        raise UserError(f"{path}: is a packed file; unpack it, and give the bag")
    with _of_library(path), ExitStack() as stack:
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.interfaces import MessageDefinitionFormat
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise UserError("import bag: needs rosbags; in a clone of slamgauge run: pip install '.[ros]'") from None
        types = dict[str, Any]()
        for file in sorted(file for folder in msgs for file in folder.rglob("*.msg")):
            package = file.resolve().parent
            package = package.parent if package.name == "msg" else package  # package/msg/Name.msg or package/Name.msg
            types |= get_types_from_msg(read_text(file), f"{package.name}/msg/{file.stem}")
        default = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
        default.register({name: value for name, value in types.items() if name not in default.fielddefs})
        reader = stack.enter_context(AnyReader([path], default_typestore=default))
        if any(each.msgdef.format == MessageDefinitionFormat.NONE for each in reader.connections):
            missing = {k: v for k, v in default.fielddefs.items() if k not in reader.typestore.fielddefs}
            reader.typestore.register(missing)
        topics = {name: (info.msgtype or "several", info.msgcount) for name, info in reader.topics.items()}
        opened_now = stack.pop_all()
    with opened_now:
        yield Bag(path, reader, dict(sorted(topics.items())))


@contextmanager
def _of_library(path: Path) -> Generator[None]:
    """Return a context in which each error is a UserError: rosbags raises many kinds of them at damaged files."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 only calls of rosbags are in the context
        what = " ".join(str(error).split())[:200] or type(error).__name__
        remedy = "give a .bag, .mcap or .db3 file, or a ROS 2 folder with its metadata.yaml"
        repair = "repair it with `rosbag reindex`, `ros2 bag reindex` or `mcap recover`"
        raise UserError(f"{path}: cannot be read ({what}); {remedy}, or {repair}") from None
