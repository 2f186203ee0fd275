import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.policies.manifest import pinned_policy, read_manifest


def test_spot_is_pinned():
    spot = pinned_policy("spot")
    assert spot.sha256 == "039b542d7e833961b7602b4f933c10415589aa1ff1fa1a8295979f6a20c2f000"
    assert spot.wheel.requirement == "judo-rai==0.1.0"
    assert spot.file_name == "spot-039b542d7e83.onnx"


def test_unknown_policy_names_the_valid_ones():
    with pytest.raises(UsageError, match=r"unknown policy 'spto'; valid: .*spot"):
        pinned_policy("spto")


@pytest.mark.parametrize("line", ["colour = 'red'", "[policies.other]\nwheel = 'nowhere'"])
def test_wrong_field_or_wheel_is_named(tmp_path, line):
    manifest = tmp_path / "manifest.toml"
    manifest.write_text(f"[wheels.toy]\n[policies.toy]\nwheel = 'toy'\n{line}\n")
    with pytest.raises(SumoError, match=r"manifest\.toml"):
        read_manifest(manifest)
