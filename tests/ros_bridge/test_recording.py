"""The file of a recording: whole after each write, and after one that fails."""

import resource
from pathlib import Path

import pytest

from tests.ros_bridge.graph import MISSING

pytest.importorskip("rclpy", reason=MISSING)
pytest.importorskip("mcap", reason="mcap is not installed; to have it: make ros")

from mcap import reader, writer

from ros_bridge.transport.recording import GrowingFile


def begun(file: Path) -> tuple[GrowingFile, "writer.Writer", int]:
    growing = GrowingFile(file)
    made = writer.Writer(growing)
    made.start(profile="ros2", library="test")
    schema = made.register_schema("a/msg/B", "ros2msg", b"int32 a")
    return growing, made, made.register_channel("/topic", "cdr", schema)


def messages(file: Path) -> list[int]:
    with file.open("rb") as stream:
        return [message.sequence for _, _, message in reader.make_reader(stream).iter_messages()]


def add(made: "writer.Writer", channel: int, number: int, size: int = 8) -> None:
    made.add_message(channel, log_time=number, publish_time=number, sequence=number, data=bytes(size))


def test_file_is_readable_after_each_flush_and_at_the_end(tmp_path: Path):
    file = tmp_path / "one.mcap"
    growing, made, channel = begun(file)
    for number in range(20):
        add(made, channel, number)
        made.flush()
        assert messages(file) == list(range(number + 1))
    made.finish()
    growing.close(finished=True)
    with file.open("rb") as stream:
        summary = reader.make_reader(stream).get_summary()
    assert summary is not None and summary.statistics.message_count == 20
    assert messages(file) == list(range(20))


def test_file_that_can_grow_no_more_holds_what_it_held(tmp_path: Path):
    file = tmp_path / "one.mcap"
    growing, made, channel = begun(file)
    add(made, channel, 0)
    made.flush()
    held = file.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(held) + 100, hard))
    try:
        with pytest.raises(OSError, match="File too large") as caught:
            for number in range(1, 50):
                add(made, channel, number)
                made.flush()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    growing.close(finished=False)
    assert caught.value.filename == str(file)
    assert messages(file) == [0]
