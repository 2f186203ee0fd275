import importlib.util

import pytest

from sumo_dist.errors import SumoError


def test_without_the_extra_the_error_names_it(monkeypatch):
    spec = importlib.util.find_spec("sumo_dist.view")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SumoError, match=r"pip install 'sumo-dist\[view\]'"):
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
