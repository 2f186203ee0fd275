"""How long a plan and the question after it are on their way, so that plans are made for then."""

from collections import OrderedDict, deque
from statistics import median

SAMPLES = 9  # plans; an odd number, so that a wrong one among them changes nothing
MOST_S = 0.5  # believed at most, so that no plan is made for a time far ahead
REMEMBERED = 64  # plans that were sent and may still be heard of


class RoundTrip:
    """From a plan's publication to a question that tells of it, less how long the robot held it.

    The robot names the newest plan that it has and says how long it has had it. So only times of
    one clock are subtracted from each other, and no two clocks need to agree. Each plan counts
    once, and the median of the last few: one number that is wrong, or a lie, changes nothing.
    """

    def __init__(self) -> None:
        """Start with nothing measured."""
        self._sent: OrderedDict[int, float] = OrderedDict()
        self._samples: deque[float] = deque(maxlen=SAMPLES)

    def sent(self, number: int, now: float) -> None:
        """Note that a plan was published, now [s]."""
        self._sent[number] = now
        while len(self._sent) > REMEMBERED:
            self._sent.popitem(last=False)

    def heard(self, number: int, held_s: float, now: float) -> None:
        """Note a question that came now [s], from a robot that has had a plan for a while."""
        if (sent := self._sent.pop(number, None)) is not None:
            self._samples.append(min(MOST_S, max(0.0, now - sent - held_s)))

    @property
    def seconds(self) -> float:
        """Both ways together [s]; 0 while nothing is measured."""
        return median(self._samples) if self._samples else 0.0
