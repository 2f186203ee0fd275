import pytest

from sumo_dist.errors import SumoError, UsageError
from sumo_dist.policies.manifest import pinned_policy, read_manifest


def test_spot_is_pinned():
    spot = pinned_policy("spot")
    assert spot.sha256 == "039b542d7e833961b7602b4f933c10415589aa1ff1fa1a8295979f6a20c2f000"
    assert spot.wheel.requirement == "judo-rai==0.1.0"
    assert spot.file_name == "spot-039b542d7e83.onnx"


def test_g1_is_pinned():
    fast_sac, ppo = pinned_policy("g1"), pinned_policy("g1-ppo")
    assert fast_sac.sha256 == "8346fd90778439395922a8c7256f24125ae84b8dea949128bac9e23c02bc7717"
    assert ppo.sha256 == "c9d310f479c2da1e86f468de24f64e102a2a275c14eed0fa341473612d942294"
    assert fast_sac.wheel == ppo.wheel
    assert fast_sac.wheel.licence == "Apache-2.0"


def test_unknown_policy_names_the_valid_ones():
    with pytest.raises(UsageError, match=r"unknown policy 'spto'; valid: .*spot"):
        pinned_policy("spto")


@pytest.mark.parametrize("line", ["colour = 'red'", "[policies.other]\nwheel = 'nowhere'"])
def test_wrong_field_or_wheel_is_named(tmp_path, line):
    manifest = tmp_path / "manifest.toml"
    manifest.write_text(f"[wheels.toy]\n[policies.toy]\nwheel = 'toy'\n{line}\n")
    with pytest.raises(SumoError, match=r"manifest\.toml"):
        read_manifest(manifest)
