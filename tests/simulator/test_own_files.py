"""What others could have written is not run: whose a folder is, the way to it, and each file."""

import os
import stat

import pytest

from thermohyd import own_files
from thermohyd.own_files import NotOwnError, check_own_entries, check_own_folder, make_own_folder, read_own_file


needs_root = pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
STRANGER = 12345


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "home" / "cache" / "programs"
    make_own_folder(made)
    return made


@pytest.mark.parametrize("umask", [0o000, 0o002, 0o077, 0o777])
def test_folders_are_made_for_the_user_alone(tmp_path, umask):
    before = os.umask(umask)
    try:
        make_own_folder(tmp_path / "a" / "b" / "c")
    finally:
        os.umask(before)
    made = [tmp_path / part for part in ("a", "a/b", "a/b/c")]
    assert [stat.S_IMODE(one.stat().st_mode) for one in made] == [0o700] * 3
    make_own_folder(tmp_path / "a" / "b" / "c")


@pytest.mark.parametrize("mode", [0o770, 0o720, 0o702, 0o777, 0o1777])
def test_a_folder_that_others_may_write_to_is_refused(folder, mode):
    folder.chmod(mode)
    with pytest.raises(NotOwnError, match="others may write to"):
        check_own_folder(folder)


@pytest.mark.parametrize("above", ["cache", "home"])
@pytest.mark.parametrize("mode", [0o770, 0o707])
def test_so_is_one_on_the_way_to_which_others_may_write(tmp_path, folder, above, mode):
    parent = next(one for one in folder.parents if one.name == above)
    parent.chmod(mode)
    for refuse in (check_own_folder, make_own_folder, lambda one: make_own_folder(one / "new")):
        with pytest.raises(NotOwnError, match=rf"others may write to {parent}; if they did not, `chmod go-w {parent}`"):
            refuse(folder)
    assert not (folder / "new").exists()


def test_where_entries_are_their_owners_the_next_is_the_users(tmp_path, folder):
    (tmp_path / "home").chmod(0o1777)
    check_own_folder(folder)


@needs_root
@pytest.mark.parametrize(("of", "shared"), [("programs", False), ("cache", False), ("home", False), ("cache", True)])
def test_another_users_folder_is_refused(tmp_path, folder, of, shared):
    (tmp_path / "home").chmod(0o1777 if shared else 0o755)
    os.chown(next(one for one in (folder, *folder.parents) if one.name == of), STRANGER, STRANGER)
    with pytest.raises(NotOwnError, match="belongs to another user"):
        check_own_folder(folder)


@needs_root
def test_where_entries_are_their_owners_roots_are_not_another_users(tmp_path, folder, monkeypatch):
    """A link of root's in /tmp may have been put there by anybody."""
    (tmp_path / "home").chmod(0o1777)
    monkeypatch.setattr(own_files, "_way_to", lambda path: iter([tmp_path / "home", tmp_path / "home" / "cache"]))
    monkeypatch.setattr(os, "geteuid", lambda: STRANGER)
    with pytest.raises(NotOwnError, match="cache belongs to another user"):
        check_own_folder(folder)


def test_links_on_the_way_are_followed_and_asked(tmp_path, folder):
    (tmp_path / "near").symlink_to("home/../home")
    (tmp_path / "far").symlink_to(tmp_path / "near")
    check_own_folder(tmp_path / "far" / "cache" / "programs")
    shared = tmp_path / "shared"
    shared.mkdir()
    (shared / "link").symlink_to(folder.parent)
    (tmp_path / "through").symlink_to(shared / "link")
    check_own_folder(tmp_path / "through" / "programs")
    shared.chmod(0o777)
    with pytest.raises(NotOwnError, match=f"others may write to {shared}"):
        check_own_folder(tmp_path / "through" / "programs")
    shared.chmod(0o1777)
    check_own_folder(tmp_path / "through" / "programs")
    if os.geteuid() == 0:
        os.chown(shared / "link", STRANGER, STRANGER, follow_symlinks=False)
        with pytest.raises(NotOwnError, match=f"{shared / 'link'} belongs to another user"):
            check_own_folder(tmp_path / "through" / "programs")
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    with pytest.raises(OSError, match="symbolic links"):
        check_own_folder(tmp_path / "circle")


def planted(folder, how):
    file = folder / "planted"
    (folder.parent / "elsewhere").write_bytes(b"planted")
    if how == "link":
        file.symlink_to(folder.parent / "elsewhere")
    elif how == "pipe":
        os.mkfifo(file, 0o600)
    elif how == "folder":
        file.mkdir(0o700)
    else:
        file.write_bytes(b"planted")
        file.chmod(how if isinstance(how, int) else 0o600)
    if how == "stranger":
        os.chown(file, STRANGER, STRANGER)
    return file


PLANTED = [0o620, 0o602, 0o666, "link", "pipe", pytest.param("stranger", marks=needs_root)]


@pytest.mark.parametrize("how", [*PLANTED, "folder"])
def test_a_file_that_others_could_have_written_is_not_read(folder, how):
    with pytest.raises((NotOwnError, IsADirectoryError)):
        read_own_file(planted(folder, how), 100)


@pytest.mark.parametrize("mode", [0o600, 0o400, 0o644])
def test_a_file_of_the_users_is_read_up_to_a_size(folder, mode):
    file = planted(folder, mode)
    assert read_own_file(file, 7) == b"planted"
    with pytest.raises(ValueError, match="more than 6 bytes"):
        read_own_file(file, 6)
    with pytest.raises(FileNotFoundError):
        read_own_file(folder / "none", 100)


@pytest.mark.parametrize("how", [*PLANTED, "second name"])
def test_nor_is_a_folder_of_another_program_that_holds_one(folder, how):
    folder.chmod(0o755)
    within = folder / "within"
    within.mkdir()
    file = planted(within, how)
    if how == "second name":
        (folder.parent / "again").hardlink_to(file)
    with pytest.raises(NotOwnError, match=f"{file} is not this user's, or others may write to it; remove it"):
        check_own_entries(folder)


def test_what_a_lavish_umask_left_in_a_closed_folder_is_closed(folder):
    file = planted(folder, 0o664)
    check_own_entries(folder)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_where_no_system_says_whose_a_file_is_none_is(folder, monkeypatch):
    monkeypatch.delattr(os, "geteuid")
    with pytest.raises(NotOwnError, match="does not say whose a file is"):
        check_own_folder(folder)


def test_it_is_said_once(capsys, monkeypatch):
    monkeypatch.setattr(own_files, "_said", False)
    for _ in range(2):
        own_files.say_not_own(NotOwnError("/x belongs to another user"))
    said = "thermohyd: warning: compiled programs are neither kept nor read: /x belongs to another user\n"
    assert capsys.readouterr().err == said
