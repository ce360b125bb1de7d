from pathlib import Path

from v3studio.pipelines.events import Log
from v3studio.pipelines.events.event_log import LogFollower


def line(message: str, time: float) -> str:
    return Log(message=message, time=time).to_json() + "\n"


def messages(follower: LogFollower) -> tuple[bool, list[str]]:
    anew, events = follower.poll()
    return anew, [event.message for event in events if isinstance(event, Log)]


def test_lines_are_read_once_and_when_they_are_complete(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    follower = LogFollower(path)
    assert messages(follower) == (False, [])
    path.write_text("")
    assert messages(follower) == (True, [])
    first, second = line("one", 1.0), line("two", 2.0)
    path.write_text(first + second[:9])
    assert messages(follower) == (False, ["one"])
    assert messages(follower) == (False, [])
    path.write_text(first + second)
    assert messages(follower) == (False, ["two"])


def test_a_new_log_with_the_inode_of_the_old_one_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    follower = LogFollower(path)
    path.write_text(line("one", 1.0))
    inode = path.stat().st_ino
    assert messages(follower) == (True, ["one"])
    for time, texts in ((2.0, ["two"]), (3.0, ["six", "ten"])):  # as long as what was read, and longer
        path.write_text("".join(line(text, time) for text in texts))  # in place, as if the inode were used again
        assert path.stat().st_ino == inode
        assert messages(follower) == (True, texts)
