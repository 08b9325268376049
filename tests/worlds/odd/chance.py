"""Odd in what decides an episode: chance, time, files, other processes; in what a copy holds; and in episodes."""

import itertools
import os
import random
import threading
import time

import gymnasium
import numpy as np

from tests.worlds.odd.plain import PLACES, Plain, odd

NONDETERMINISTIC = r"nondeterministic: two plays of one seed differ"


@odd(NONDETERMINISTIC + ".*call super")
class NotSeeded(Plain):
    def reset(self, *, seed=None, options=None):
        self.count, self.place = 0, 2
        return self.observe(), {}


@odd(NONDETERMINISTIC)
class GlobalNumpy(Plain):
    def move(self, action):
        super().move(np.random.randint(PLACES))


@odd(NONDETERMINISTIC)
class GlobalRandom(Plain):
    def move(self, action):
        super().move(random.randrange(PLACES))


@odd(NONDETERMINISTIC)
class Clock(Plain):
    def observe(self):
        return np.array([self.place, time.perf_counter_ns() % 50], np.float32)


COUNTER = itertools.count()


@odd(NONDETERMINISTIC)
class AcrossEpisodes(Plain):
    def reset(self, **options):
        super().reset(**options)
        self.place = next(COUNTER) % 4
        return self.observe(), {}


@odd(r"it plays differently in a second process|" + NONDETERMINISTIC)
class ProcessNumber(Plain):
    def observe(self):
        return np.array([self.place, os.getpid() % 50], np.float32)


@odd(r"it plays differently in a second process")
class HashedText(Plain):
    def observe(self):
        return np.array([self.place, hash(f"text {self.count}") % 50], np.float32)


@odd(NONDETERMINISTIC)
class ObjectAddress(Plain):
    def observe(self):
        return np.array([self.place, id(object()) // 16 % 50 + self.serial], np.float32)

    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        self.serial = next(COUNTER) % 2


@odd(r"its np_random is a RandomState")
class OldRandomState(Plain):
    def reset(self, *, seed=None, options=None):
        self._np_random = np.random.RandomState(seed)
        self.count, self.place = 0, 1
        return self.observe(), {}


@odd()
class OwnGenerator(Plain):
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.own = random.Random(seed)
        return self.observe(), {}

    def move(self, action):
        super().move(self.own.randrange(PLACES))


PLACE = [0]


@odd(r"gone back to a copy of it in mid-episode")
class StateOutside(Plain):
    def reset(self, **options):
        PLACE[0] = 0
        return super().reset(**options)

    def move(self, action):
        super().move(action)
        PLACE[0] += 1

    def observe(self):
        return np.array([self.place, PLACE[0]], np.float32)


class Shared:
    """An object of which a copy is the object itself."""

    value = 0

    def __deepcopy__(self, memo):
        return self


@odd(r"gone back to a copy of it in mid-episode")
class CopiesShare(Plain):
    def reset(self, **options):
        self.shared = Shared()
        return super().reset(**options)

    def move(self, action):
        super().move(action)
        self.shared.value += 1

    def observe(self):
        return np.array([self.place, self.shared.value], np.float32)


@odd(noticed="it cannot be copied")
class CannotBeCopied(Plain):
    def reset(self, **options):
        self.lock = threading.Lock()
        return super().reset(**options)


@odd()
class AttributeAppears(Plain):
    def move(self, action):
        super().move(action)
        if self.count == 7:
            self.bonus = 1
        self.place = (self.place + getattr(self, "bonus", 0)) % PLACES


@odd()
class OneStep(Plain):
    def step(self, action):
        self.move(action)
        return self.observe(), 1.0, True, False, {}


@odd()
class NeverEnds(Plain):
    def step(self, action):
        observation, reward, _, _, info = super().step(action)
        self.count %= 40
        return observation, reward, False, False, info


@odd(r"ends an episode after 5 steps; ask for 5 or fewer", max_episode_steps=5)
class TwoLimits(Plain):
    pass


@odd()
class LimitInfinite(Plain):
    max_steps = float("inf")


@odd()
class LimitText(Plain):
    max_steps = "many"


@odd(r"max_steps raised RuntimeError: no level yet")
class LimitRaises(Plain):
    @property
    def max_steps(self):
        raise RuntimeError("no level yet")


@odd()
class StepsAfterEnd(Plain):
    def step(self, action):
        observation, reward, _, _, info = super().step(action)
        return observation, reward, self.count == 3, False, info


@odd()
class CostsEachStep(Plain):
    def reward(self):
        return -1


class Doubled(gymnasium.Wrapper):
    """A wrapper that doubles rewards, and counts."""

    def reset(self, **options):
        self.steps = 0
        return super().reset(**options)

    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        self.steps += 1
        return observation, 2 * reward + self.steps, terminated, truncated, info


@odd()
def wrapped(render_mode=None):
    return Doubled(Plain(render_mode))


class Forgetful(gymnasium.Wrapper):
    """A wrapper whose step gives four values."""

    def step(self, action):
        return super().step(action)[:4]


@odd(r"step\(\) returned a tuple of 4 values")
def wrapped_with_four_values(render_mode=None):
    return Forgetful(Plain(render_mode))


class Keeping(gymnasium.Wrapper):
    """A wrapper that keeps an object of its own."""

    def reset(self, **options):
        self.kept = object()
        return super().reset(**options)


@odd(r"a wrapper's state may hold only")
def wrapped_with_an_object(render_mode=None):
    return Keeping(Plain(render_mode))
