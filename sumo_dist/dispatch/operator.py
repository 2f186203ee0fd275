"""An operator on the bus: commands in, each carried out once, and an answer to every one."""

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence

from sumo_dist.episode.command import Command
from sumo_dist.errors import Interrupted
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import Ack, CommandMessage

REMEMBERED = 256  # newest commands whose answer is given again when they come again
WAITING = 256  # commands that may wait for a tick; more are dropped, and their senders repeat them


class BusOperator:
    """Takes commands for one robot; see `episode.command.Operator`."""

    def __init__(self, bus: Bus, stop: threading.Event, arrived: Callable[[], None]) -> None:
        """Subscribe.

        Args:
            bus: the robot's.
            stop: ends the waiting of a robot that is paused.
            arrived: is told when a command has come.
        """
        self._bus, self._stop, self._notify = bus, stop, arrived
        self._changed = threading.Condition()
        self._waiting: deque[Command] = deque()
        self._known: OrderedDict[tuple[str, int], Ack | None] = OrderedDict()
        bus.subscribe(CommandMessage, self._on_command)

    def stop_waits(self) -> bool:
        """Whether a stop has come that was not taken yet."""
        with self._changed:
            return any(command.verb == "stop" for command in self._waiting)

    def take(self, tick: int, wait: float) -> Sequence[Command]:
        """Return the commands that have come, waiting up to `wait` [s] for one.

        Raises:
            Interrupted: the robot is told to end.
        """
        del tick
        with self._changed:
            if wait > 0:
                self._changed.wait_for(lambda: bool(self._waiting), wait)
            commands = list(self._waiting)
            self._waiting.clear()
        if wait > 0 and self._stop.is_set():
            raise Interrupted("told to stop while it was paused")
        return commands

    def answer(self, command: Command, tick: int, refusal: str) -> None:
        """Tell the sender, now and whenever the command comes again."""
        run = self._bus.run or ""
        ack = Ack(run, command.number, command.sender, max(tick, 0), refusal[:1000])
        with self._changed:
            self._known[command.sender, command.number] = ack
        self._bus.publish(ack)

    def _on_command(self, message: CommandMessage) -> None:
        command = message.command
        key = command.sender, command.number
        with self._changed:
            again = self._known.get(key)
            if key not in self._known and len(self._waiting) < WAITING:
                self._known[key] = None
                while len(self._known) > REMEMBERED:
                    self._known.popitem(last=False)
                self._waiting.append(command)
                self._changed.notify_all()
        if again is not None:
            self._bus.publish(again)
        else:
            self._notify()
