"""Folders of pages: nobody's session is written over by anybody else's."""

import json

import pytest

from polefence.base.errors import InputError, OutputError
from polefence.region.regions import Disk
from polefence.studio import Page, Session, State
from polefence.studio.folders import Folders, TakenError
from support.browser import until
from support.studios import subject

pytest.importorskip("panel")


class Tab:
    """A page, as far as folders know one."""


def saved(folders, page, name, text):
    """Save a session under a name; return the folder."""
    with folders.writing(page, name) as folder:
        (folder / "session.json").write_text(text)
    return folder


def read(folder):
    return (folder / "session.json").read_text()


def test_each_page_begins_with_a_name_of_its_own(tmp_path):
    folders, tabs = Folders(tmp_path / "studio"), [Tab(), Tab(), Tab()]
    assert [folders.begin(own) for own in tabs] == ["studio", "studio-2", "studio-3"]
    folders.end(tabs[1])
    assert folders.begin(Tab()) == "studio-2"
    assert not list(tmp_path.iterdir())  # nothing is made before somebody saves


def test_a_page_saves_again_and_another_one_never_over_it(tmp_path):
    folders, first, second = Folders(tmp_path / "studio"), Tab(), Tab()
    name, other = folders.begin(first), folders.begin(second)
    assert saved(folders, first, name, "1") == tmp_path / "studio"
    assert read(saved(folders, first, name, "2")) == "2"
    with pytest.raises(TakenError, match="another session is saved there.* as studio-2") as caught:
        saved(folders, second, name, "3")
    assert caught.value.free == other == "studio-2"
    assert read(tmp_path / "studio") == "2"
    assert read(saved(folders, second, other, "3")) == "3"


def test_two_studios_in_one_place_never_write_over_each_other(tmp_path):
    """Two people, two processes: each knows what it wrote itself."""
    one, other, first, second = Folders(tmp_path / "s"), Folders(tmp_path / "s"), Tab(), Tab()
    assert (one.begin(first), other.begin(second)) == ("s", "s")  # neither saved yet
    saved(one, first, "s", "1")
    with pytest.raises(TakenError) as caught:
        saved(other, second, "s", "2")
    saved(other, second, caught.value.free, "2")
    saved(one, first, "s", "3")
    assert (read(tmp_path / "s"), read(tmp_path / "s-2")) == ("3", "2")
    assert Folders(tmp_path / "s").begin(Tab()) == "s-3"  # nor does one that begins later


def test_what_somebody_else_wrote_meanwhile_stays(tmp_path):
    folders, own = Folders(tmp_path / "s"), Tab()
    saved(folders, own, folders.begin(own), "1")
    (tmp_path / "s" / "session.json").write_text("another's")
    with pytest.raises(TakenError):
        saved(folders, own, "s", "2")
    assert read(tmp_path / "s") == "another's"


def test_a_session_that_is_opened_is_gone_on_with_by_one_page_only(tmp_path):
    place = tmp_path / "s"
    place.mkdir()
    (place / "session.json").write_text("opened")
    folders, first, second = Folders(place, place / "session.json"), Tab(), Tab()
    assert (folders.begin(first), folders.begin(second)) == ("s", "s-2")
    assert read(saved(folders, first, "s", "1")) == "1"
    with pytest.raises(TakenError):
        saved(folders, second, "s", "2")
    other = Folders(tmp_path / "t", place / "session.json")  # -o says another place
    assert other.begin(Tab()) == "t"


@pytest.mark.parametrize("name", ["report.html", "code", "design"])
def test_reports_and_code_are_kept_too(tmp_path, name):
    folder = tmp_path / "s"
    folder.mkdir()
    if name == "report.html":
        from polefence.show.report import MARK

        (folder / name).write_bytes(b"<!doctype html>" + MARK)
    else:
        (folder / name).mkdir()
    assert Folders(folder).begin(Tab()) == "s-2"


def test_a_folder_with_the_spec_alone_or_a_strangers_files_is_written_into(tmp_path):
    (tmp_path / "plant.toml").write_text("name = 'car'")
    folders, own = Folders(tmp_path), Tab()
    assert saved(folders, own, folders.begin(own), "1") == tmp_path


def test_two_at_once_do_not_get_one_folder(tmp_path, monkeypatch):
    """Whoever makes the folder has it, where both found it free."""
    one, other, first, second = Folders(tmp_path / "s"), Folders(tmp_path / "s"), Tab(), Tab()
    one.begin(first)
    other.begin(second)
    free = Folders._is_free

    def late(self, folder, page):
        found = free(self, folder, page)
        if self is other and folder == tmp_path / "s" and found:
            saved(one, first, "s", "1")
        return found

    monkeypatch.setattr(Folders, "_is_free", late)
    with pytest.raises(TakenError):
        saved(other, second, "s", "2")
    assert read(tmp_path / "s") == "1"


@pytest.mark.parametrize(
    "name", ["", "..", ".", "../x", "a/b", "/x", ".hidden", "x" * 81, "a\n", " a"]
)
def test_a_name_is_that_of_one_folder(tmp_path, name):
    folders, own = Folders(tmp_path / "s"), Tab()
    folders.begin(own)
    with (
        pytest.raises(InputError, match="must be letters, digits, spaces"),
        folders.writing(own, name),
    ):
        pass
    assert not (tmp_path / "s").exists()


def test_nothing_is_written_through_a_link(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "s").symlink_to(tmp_path / "elsewhere")
    folders, own = Folders(tmp_path / "s"), Tab()
    assert folders.begin(own) == "s-2"
    with pytest.raises(OutputError, match="is a symbolic link"), folders.writing(own, "s"):
        pass


def test_a_page_asks_for_a_name_and_says_which_is_free(tmp_path):
    folders = Folders(tmp_path / "studio")
    state = State.first(subject(), Disk(-40, 31))
    pages = [Page(subject(), state, folders) for _ in range(2)]
    try:
        first, second = pages
        assert [own.name.value for own in pages] == ["studio", "studio-2"]
        first.save.clicks += 1
        assert until(lambda: "saved" in first.message.object)
        second.name.value = "studio"
        second.save.clicks += 1
        assert until(lambda: "another session is saved there" in second.message.object)
        assert second.name.value == "studio-2"
        second.save.clicks += 1
        assert until(lambda: "saved" in second.message.object)
        assert "studio-2" in second.message.object
        text = (tmp_path / "studio" / "session.json").read_text()
        assert json.loads(text)["region"] == "disk(-40, 31)"
        assert Session.read(tmp_path / "studio-2" / "session.json").text == subject().text
    finally:
        for own in pages:
            own.close()


def test_sliders_say_what_the_spec_does(tmp_path):
    page = Page(subject(), State.first(subject(), Disk(-40, 31)), tmp_path)
    try:
        assert [own.label for own in page.sliders] == ["sprung mass m1 [kg]", "age beta"]
        assert page.map.figure.xaxis.axis_label == "sprung mass m1 [kg]"
    finally:
        page.close()


def test_a_long_proof_says_so(tmp_path, monkeypatch):
    page = Page(subject(), State.first(subject(), Disk(-40, 31)), tmp_path)
    try:
        assert until(lambda: "proved" in page.badge.object and "working" not in page.badge.object)
        done, page.answer = page.answer, None
        page._begun()
        assert "being searched: disk(-40, 31)<" in page.badge.object
        page._since -= 12
        page._going("proof, inequality 7")
        assert (
            "being searched: disk(-40, 31); proof, inequality 7; for 12 s now" in page.badge.object
        )
        page.answer = done
        page._at_work()  # a word that comes late changes nothing
        assert "for 12 s now" in page.badge.object
    finally:
        page.close()
