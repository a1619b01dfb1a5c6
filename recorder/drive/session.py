"""Runs a drive from start to end: in real time with a person and a window, or as fast as possible."""

import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from carlaloc_env.core.clock import STEP_TICKS, TICK_HZ
from carlaloc_env.core.ego import Controls
from carlaloc_env.core.errors import OutputError
from carlaloc_env.driving.driving_world import DrivingWorld
from carlaloc_env.timeline.actors import ActorCatalog
from recorder.devices.base import Command, Device
from recorder.devices.human import HumanDevice
from recorder.devices.keys import KeyPanel
from recorder.drive.episode_listener import FIRST_DRIVEN_TICK, EpisodeListener, of_car
from recorder.drive.pacer import Pacer
from recorder.drive.rule_monitor import RuleMonitor
from recorder.episode.ego_messages import VIOLATIONS
from recorder.episode.episode import Episode
from recorder.episode.writer import EpisodeWriter
from recorder.window.drive_status import DriveStatus

_IDLE_S = 0.004
_WARNING_S = 2.5
_STEP_ON_M = 1.0
"""Distance that counts as progress [m]."""
_STUCK_S, _STUCK_THROTTLE = 3.0, 0.2
"""A car is stuck that has been given so much throttle for so long [s] and has not moved by `_STEP_ON_M`."""
_ANNOUNCED_M, _ANNOUNCED_S, _GENTLE_MPS2 = 25.0, 3.0, 1.5
"""The end of the route is announced so far ahead [m], or so long [s] before gentle braking begins [m/s²]."""
_FAREWELL_S = 1.5
"""How long the window shows that the drive is over [s]."""


class Cockpit(Protocol):
    """Interface of a display of a drive, e.g. a window."""

    def show(self, world: DrivingWorld, status: DriveStatus) -> None:
        """Show the present."""

    def photo(self, world: DrivingWorld, status: DriveStatus, path: Path) -> None:
        """Write a picture of the present to a PNG; an `OutputError` where that fails."""


class DriveSession:
    """Session of one drive: device, world, recording and pace.

    Args:
        world: The living town.
        driver: Who drives.
        seed: Seed of the drive.
        begin: Makes the writer once the actors are known.
        finished: Whether the drive is over.
        end_tick: Tick at which it is over in any case.
        progress: Called four times a second with the progress of the drive.
        others: Makes the drivers of the other cars, anew for each attempt.
    """

    def __init__(
        self,
        world: DrivingWorld,
        driver: Device,
        *,
        seed: int,
        begin: Callable[[ActorCatalog], EpisodeWriter],
        finished: Callable[[DrivingWorld], bool],
        end_tick: int,
        progress: Callable[[float, float], None] | None = None,
        others: Callable[[], Sequence[Device]] = tuple,
    ) -> None:
        self._world, self._driver, self._seed = world, driver, seed
        self._new_others = others
        self._begin, self._finished, self._end_tick = begin, finished, end_tick
        self._progress = progress
        self.status = DriveStatus(device=driver.name)
        self.listener = EpisodeListener(begin)
        self.attempts: list[Path] = []
        """Earlier attempts that were given up at a restart; nothing is thrown away."""
        self.photos: list[Path] = []
        """Photos that the driver took."""
        self._note, self._note_until = "", 0
        self.slowest = 1.0
        """Lowest speed of the world over real time."""
        self._begin_attempt()
        self._warned: dict[str, int] = {}
        self._checkpoint = 0
        self._switched = ("", False, False)
        self._stood_m, self._pushed_ticks = np.zeros(3), 0
        self._over = False
        self.stuck = False
        """Whether the drive ended because the car made no progress."""

    def _begin_attempt(self) -> None:
        """Forget what rule monitors and the other drivers remember."""
        self._rules = [RuleMonitor(self._world.town.network) for _ in self._world.cars]
        self._others = self._new_others()

    def start(self) -> None:
        """Open the episode and place the ego and all actors."""
        self._world.reset(self._seed, self.listener)

    def run_freely(self, *, patience_s: float = math.inf) -> None:
        """Drive to the end as fast as the machine can.

        Args:
            patience_s: The drive also ends when the car makes no progress along its route for so long [s].
        """
        farthest_m, since = -math.inf, self._world.tick_count
        while not self._is_over():
            self._tick(self._driver.read(self._world.driver_view()))
            if (reached_m := sum(car.route_s_m for car in self._world.cars)) > farthest_m + _STEP_ON_M:
                farthest_m, since = reached_m, self._world.tick_count
            if self._world.tick_count - since > patience_s * TICK_HZ:
                self.listener.event(self._world.tick_count, "stuck", {"route_m": self.route_m})
                self.stuck = True
                return

    def run_live(self, panel: HumanDevice | KeyPanel, cockpit: Cockpit | None) -> None:
        """Drive in real time until the end, or until the driver ends it.

        Args:
            panel: Who takes in events: the device, or the keys of a drive without a person at the wheel.
            cockpit: What shows the drive.
        """
        if cockpit is not None:
            cockpit.show(self._world, self.status)
        self._remember_switches()
        pacer = Pacer(getattr(panel, "clock", time.perf_counter))
        while not self._is_over():
            panel.poll()
            for kind, name in panel.plugged:
                self.listener.event(self._world.tick_count, kind, {"device": name})
            for command in panel.commands:
                self._execute(command, pacer, cockpit)
            if panel.inputs.closed or self._over:
                break
            count = 0 if self.status.paused else pacer.due()
            for _ in range(count):
                if self._is_over():
                    break
                self._tick(self._driver.read(self._world.driver_view()))
            if self.status.paused:
                pacer.restart()
            self._update_status(panel, pacer)
            if cockpit is not None:
                cockpit.show(self._world, self.status)
            if cockpit is None or self.status.paused:
                time.sleep(_IDLE_S)
        if cockpit is not None and self.is_driven:
            self.status.message = "the route has been driven: the drive ends here"
            cockpit.show(self._world, self.status)
            time.sleep(_FAREWELL_S)

    def replay_controls(self, episode: Episode, ticks: int) -> None:
        """Drive by the controls of an episode up to a tick, its other events included."""
        arising = (*VIOLATIONS, "collision", "given_up", "end")
        kept = deque(event for event in episode.events if event.kind not in arising)
        for tick in range(FIRST_DRIVEN_TICK, ticks + 1):
            self.listener.raw = episode.raw_controls.at(tick)
            self._advance(episode.controls.at(tick))
            while kept and kept[0].tick <= self._world.tick_count:
                event = kept.popleft()
                self.listener.event(event.tick, event.kind, event.data)

    @property
    def duration_s(self) -> float:
        """Length of the drive so far [s]."""
        return self._world.tick_count / TICK_HZ

    @property
    def route_m(self) -> float:
        """Way along the route so far [m]; not negative where the car has gone back behind the start."""
        return max(self._world.route_s_m, 0.0)

    @property
    def is_driven(self) -> bool:
        """Whether the route has been driven, in drives that end by it."""
        return self._finished(self._world)

    def finish(self) -> None:
        """Note the end; closing the file is the writer's."""
        self.listener.event(self._world.tick_count, "end", {"route_m": self.route_m})

    def _is_over(self) -> bool:
        return self._over or self._world.tick_count >= self._end_tick or self.is_driven

    def _tick(self, controls: Controls) -> None:
        self.listener.raw = getattr(self._driver, "raw", None)
        self._advance(controls)
        self.status.controls = controls
        position_m = self._world.state.position_m
        if math.dist(position_m, self._stood_m) > _STEP_ON_M:
            self._stood_m, self._pushed_ticks = position_m, 0
        self._pushed_ticks += controls.throttle > _STUCK_THROTTLE and not controls.handbrake
        if self._progress is not None and self._world.tick_count % 50 == 0:
            self._progress(self._world.tick_count / TICK_HZ, self.route_m)

    def _advance(self, controls: Controls) -> None:
        world = self._world
        others = zip(self._others, world.cars[1:], strict=True)
        world.tick(controls, *(driver.read(car.driver_view()) for driver, car in others))
        if world.tick_count % STEP_TICKS:
            return
        for number, (car, rules) in enumerate(zip(world.cars, self._rules, strict=True)):
            view = car.driver_view()
            for kind in rules.update(view):
                where = [round(float(value), 2) for value in view.position_m]
                data = {"position_m": where, "route_m": view.route_s_m, **of_car(number)}
                self.listener.event(world.tick_count, kind, data)
                if number == 0:
                    self._warned[kind] = world.tick_count

    def _update_status(self, panel: HumanDevice | KeyPanel, pacer: Pacer) -> None:
        """Bring the status up to date."""
        status, now = self.status, self._world.tick_count
        if self.listener.is_touching:
            self._warned["collision"] = now
        recent = {kind for kind, tick in self._warned.items() if now - tick < _WARNING_S * TICK_HZ}
        status.warnings = tuple(sorted(recent | set(self._rules[0].present)))
        note = self._note if now <= self._note_until else None
        status.message = panel.message or note or self._way_out(panel) or self._end_ahead()
        status.buttons = panel.buttons
        status.slow = pacer.speed if pacer.is_slow and not status.paused else None
        self.slowest = min(self.slowest, pacer.speed)
        status.size_mb = self.listener.writer.size_bytes / 1e6
        status.collisions = self.listener.counts["collision"]
        status.broken = sum(self.listener.counts[kind] for kind in VIOLATIONS)

    @property
    def _restart_place(self) -> str:
        return "checkpoint" if self._checkpoint else "start"

    def _way_out(self, panel: HumanDevice | KeyPanel) -> str | None:
        """Advice to a person whose car is stuck."""
        if self._pushed_ticks < _STUCK_S * TICK_HZ or not isinstance(panel, HumanDevice):
            return None
        names = (Command.REVERSE, "R"), (Command.RESTART, "backspace")
        keys = [f"button {panel.buttons[c.value]}" if c.value in panel.buttons else key for c, key in names]
        return f"stuck? {keys[0]}: reverse gear; {keys[1]}: back to the {self._restart_place}"

    def _end_ahead(self) -> str | None:
        """Announcement of the end of an open route, in time to stop there."""
        if self._world.route.closed:
            return None
        left_m, speed = self._world.route.length_m - self._world.route_s_m, self._world.state.speed_mps
        braking_m = speed * speed / (2.0 * _GENTLE_MPS2)
        if left_m > max(_ANNOUNCED_M, braking_m + speed * _ANNOUNCED_S):
            return None
        return f"the route ends in {max(left_m, 0.0):.0f} m: stop there"

    def _execute(self, command: Command, pacer: Pacer, cockpit: Cockpit | None) -> None:
        status, tick = self.status, self._world.tick_count
        if command is Command.QUIT:
            self._over = True
        elif command is Command.PAUSE:
            status.paused = not status.paused
            self.listener.writer.flush()
        elif command is Command.HELP:
            status.help = not status.help
        elif command is Command.CAMERA:
            status.view += 1
        elif command in (Command.INDICATOR_LEFT, Command.INDICATOR_RIGHT):
            side = "left" if command is Command.INDICATOR_LEFT else "right"
            status.indicator = "" if status.indicator == side else side
            self.listener.event(tick, "indicator", {"side": status.indicator or "off"})
        elif command is Command.HEADLAMPS:
            status.headlamps = not status.headlamps
            self.listener.event(tick, "headlamps", {"on": status.headlamps})
        elif command is Command.CHECKPOINT:
            self._checkpoint = tick
            self._remember_switches()
            self.listener.event(tick, "checkpoint")
        elif command is Command.PHOTO and cockpit is not None:
            self._photo(cockpit)
            pacer.restart()
        elif command is Command.RESTART:
            status.message = f"going back to the {self._restart_place} …"
            if cockpit is not None:
                cockpit.show(self._world, status)
            self._restart()
            pacer.restart()

    def _photo(self, cockpit: Cockpit) -> None:
        """Write a photo beside the episode; one that fails costs no drive."""
        path = _free_name(self.listener.writer.path, "photo", len(self.photos) + 1, ".png")
        try:
            cockpit.photo(self._world, self.status, path)
        except OutputError as error:
            self._note = f"no photo: {error}"
        else:
            self.photos.append(path)
            self._note = f"photo: {path.name}"
        self._note_until = self._world.tick_count + round(_WARNING_S * TICK_HZ)

    def _remember_switches(self) -> None:
        """Keep what the driver has switched on, for a restart."""
        status = self.status
        self._switched = status.indicator, status.headlamps, status.controls.reverse

    def _restart(self) -> None:
        """Go back to the checkpoint: close this attempt and drive its beginning again, tick by tick."""
        writer = self.listener.writer
        given_up = _free_name(writer.path, "attempt", len(self.attempts) + 1, writer.path.suffix)
        self.listener.event(self._world.tick_count, "given_up", {"checkpoint_tick": self._checkpoint})
        writer.close(into=given_up)
        self.attempts.append(given_up)
        self.listener = EpisodeListener(self._begin)
        self._begin_attempt()
        self._warned.clear()
        self._note, self._pushed_ticks = "", 0
        self.status.indicator, self.status.headlamps, reverse = self._switched
        self.status.controls = Controls(reverse=reverse)
        if isinstance(self._driver, HumanDevice):
            self._driver.begin(reverse=reverse)
        self.start()
        if self._checkpoint > 1:
            self.replay_controls(Episode.load(given_up), self._checkpoint + 1)


def _free_name(path: Path, kind: str, number: int, suffix: str) -> Path:
    while True:
        name = path.with_name(f"{path.stem}_{kind}{number}{suffix}")
        if not name.exists():
            return name
        number += 1
