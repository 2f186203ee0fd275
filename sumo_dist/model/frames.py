"""Frames of a model by name."""

from dataclasses import dataclass


@dataclass(frozen=True)
class FrameRef:
    """A frame whose pose a rollout records: a site or a body of the model."""

    kind: str  # "site" | "body"
    name: str
