import shutil
from pathlib import Path

import pytest

from tests.support.looping import wait_in_loop
from v3studio.gui.models.take.take_queue import TakeQueue
from v3studio.gui.pages.start.drawing import StartImage
from v3studio.gui.pages.start.page import StartPage
from v3studio.pipelines.batch.queue_file import QueueFile


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StartPage:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    queue = TakeQueue(QueueFile(tmp_path / "queue.json"))
    monkeypatch.setattr("v3studio.gui.pages.start.page.LOOK_EVERY", 0.0)
    return StartPage(queue, True)


def test_cards_and_pictures_come_singly_and_follow_the_disk(page: StartPage, take_copy: Path, tmp_path: Path) -> None:
    places = [str(take_copy), str(tmp_path / "gone"), "https://example.org/walk"]

    def states() -> list[str]:
        page.look(places)
        return [page.cards[place].kind for place in places if place in page.cards]

    wait_in_loop("cards", lambda: states() == ["take", "missing", "web"])
    wait_in_loop("a picture", lambda: bool(states()) and page.pictures.get(places[0]) is not None)
    assert places[1] not in page.pictures
    shutil.rmtree(take_copy)
    wait_in_loop("the folder is gone", lambda: states() == ["missing", "missing", "web"])
    page.look(places[2:])
    assert set(page.cards) == {places[2]}


def test_everything_is_reached_by_arrow_keys_and_by_tab(page: StartPage) -> None:
    page.places = tuple(f"/takes/{number}" for number in range(5))
    page.back = "walk"
    for size in ((1280, 760), (820, 600)):
        picture = StartImage(*size, 16)
        picture.draw(page)
        names = [name for _, name in picture.boxes.all]
        assert {"back", "new", "open", "address", "sample", *(f"card {number}" for number in range(5))} <= set(names)
        reached, waiting = set(), ["new"]
        while waiting:
            name = waiting.pop()
            reached.add(name)
            for direction in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                page.focus = name
                page.move(picture.boxes.all, *direction)
                if page.focus not in reached:
                    waiting.append(page.focus)
        assert reached == set(names), size
        page.focus, walked = names[0], []
        for _ in names:
            page.step(picture.boxes.all, 1)
            walked.append(page.focus)
        assert sorted(walked) == sorted(names)
