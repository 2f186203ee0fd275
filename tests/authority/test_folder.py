import shutil

import pytest

from sumo_dist.authority.certificates import KeysError
from sumo_dist.authority.folder import KeyFolder
from sumo_dist.authority.store import Authority


def read(authority, role="worker", *wanted):
    return KeyFolder.read(authority.folder("r-1", role), wanted)


def copy(authority, role, name):
    own = authority.folder("r-1", "worker") / name
    shutil.copy(authority.folder("r-1", role) / name, own)


def test_keys_of_another_role_are_named(authority):
    with pytest.raises(KeysError, match="is for the role worker; needed here: robot or operator"):
        read(authority, "worker", "robot", "operator")


def test_the_authority_itself_is_no_role(authority):
    folder = authority.folder("r-1", "worker")
    shutil.copy(folder / "ca.pem", folder / "cert.pem")
    shutil.copy(authority.home / "authority" / "ca.key", folder / "key.pem")
    with pytest.raises(KeysError, match=r"role \(none\); needed here: worker"):
        KeyFolder.read(folder, ("worker",))


@pytest.mark.parametrize("name", ["ca.pem", "cert.pem", "key.pem"])
@pytest.mark.parametrize("content", [None, b"", b"hello", b"\0\xff" * 50])
def test_a_missing_or_damaged_file_is_named(authority, name, content):
    path = authority.folder("r-1", "worker") / name
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(KeysError, match=rf"{name}.*No such file|{name} is not a (certificate|pr)"):
        read(authority)


def test_no_folder_is_named(tmp_path):
    with pytest.raises(KeysError, match=r"none is no folder with ca\.pem, cert\.pem and key\.pem"):
        KeyFolder.read(tmp_path / "none")


def test_a_key_of_another_certificate_is_named(authority):
    copy(authority, "robot", "key.pem")
    with pytest.raises(KeysError, match=r"key\.pem is not the key of .*cert\.pem"):
        read(authority)


def test_a_certificate_of_another_authority_is_named(authority, tmp_path):
    other = Authority.found(tmp_path / "other")
    shutil.copy(other.home / "authority" / "ca.pem", authority.folder("r-1", "worker"))
    with pytest.raises(KeysError, match=r"cert\.pem was not issued by the authority of .*ca\.pem"):
        read(authority)


def test_an_expired_certificate_names_the_way_out(authority):
    authority.host("old", ["worker"], [], 1e-9)
    with pytest.raises(KeysError, match=r"has expired on .*: `sumo-dist keys renew old` where"):
        KeyFolder.read(authority.folder("old", "worker"))
