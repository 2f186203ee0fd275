"""The optimizer's side of the bus: what the robot asks, and of which episode."""

import threading
import time
from dataclasses import replace

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.messages import EpisodeInfo, Question


class QuestionSlot:
    """Holds the newest episode and the newest question, each handed out once.

    A realtime episode's speed counts once two questions in a row have said it: it decides how long
    a plan waits for lost answers, and where it is anchored, so one that is wrong would stop
    planning for as long as it says.

    Attributes:
        arrived: time.monotonic() at which the question that was handed out last has come.
    """

    def __init__(self, bus: Bus) -> None:
        """Subscribe."""
        self.arrived = 0.0
        self._arrived = threading.Condition()
        self._came = 0.0  # when the question that waits has
        self._info: EpisodeInfo | None = None
        self._question: Question | None = None
        self._heard = (-1, 0.0)  # tick and speed of the last realtime question
        self._speed = 0.0  # that two in a row have said
        bus.subscribe(EpisodeInfo, self._on_info)
        bus.subscribe(Question, self._on_question)

    def wait(self, timeout: float) -> tuple[EpisodeInfo | None, Question | None]:
        """Return what is new, waiting at most timeout [s] for it."""
        with self._arrived:
            self._arrived.wait_for(lambda: self._info or self._question, timeout)
            new = self._info, self._question
            self.arrived = self._came
            self._info = self._question = None
            return new

    def _on_info(self, info: EpisodeInfo) -> None:
        with self._arrived:
            self._info = info
            self._arrived.notify_all()

    def _on_question(self, question: Question) -> None:
        with self._arrived:
            if question.clock == "realtime":
                tick, speed = self._heard
                if question.speed == speed and question.tick != tick:  # not the same one twice
                    self._speed = speed
                self._heard = question.tick, question.speed
                question = replace(question, speed=self._speed)
            self._question, self._came = question, time.monotonic()
            self._arrived.notify_all()
