"""Distributed sampling-based MPC over the commands of pretrained whole-body policies."""

__version__ = "0.1.0"
