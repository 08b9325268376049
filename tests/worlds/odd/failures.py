"""Odd in failing: at making, in reset or step, by ending the program, at closing."""

import sys

import gymnasium

from tests.worlds.odd.plain import Plain, odd


@odd(r"step\(\) raised ValueError: no such cell \(failures.py:\d+\), at step 8")
class StepRaises(Plain):
    def move(self, action):
        super().move(action)
        if self.count == 8:
            raise ValueError("no such cell")


@odd(r"step\(\) tried to end the program")
class StepExits(Plain):
    def move(self, action):
        super().move(action)
        if self.count == 8:
            sys.exit()


@odd(r"step\(\) raised KeyboardInterrupt")
class StepInterrupts(Plain):
    def move(self, action):
        raise KeyboardInterrupt


class Stopped(BaseException):
    """An exception that no handler of Exception sees."""


@odd(r"step\(\) raised Stopped")
class StepRaisesBaseException(Plain):
    def move(self, action):
        raise Stopped


@odd(r"step\(\) raised StopIteration")
class StepRunsOut(Plain):
    def move(self, action):
        next(iter(()))


@odd(r"step\(\) raised GeneratorExit")
class StepGeneratorExit(Plain):
    def move(self, action):
        raise GeneratorExit


@odd(r"step\(\) calls itself without end")
class StepRecurses(Plain):
    def move(self, action):
        self.move(action)


@odd(r"step\(\) raised MemoryError")
class StepMemory(Plain):
    def move(self, action):
        raise MemoryError


@odd(r"step\(\) raised ValueError: a b \(")
class StepRaisesManyLines(Plain):
    def move(self, action):
        raise ValueError("a\n\n  b")


@odd(r"step\(\) raised AssertionError \(")
class StepAsserts(Plain):
    def move(self, action):
        assert self.count < 0


@odd(r"reset\(\) raised IndexError")
class ResetRaises(Plain):
    def reset(self, **options):
        raise IndexError("list index out of range")


@odd(r"reset\(\) raised RuntimeError: once")
class ResetOnce(Plain):
    resets = 0

    def reset(self, **options):
        self.resets += 1
        if self.resets == 3:
            raise RuntimeError("once")
        return super().reset(**options)


@odd(r"reset\(\) tried to end the program")
class ResetExits(Plain):
    def reset(self, **options):
        sys.exit("no level")


@odd(r"reset\(\) raised TypeError")
class ResetWithoutSeed(Plain):
    def reset(self):
        return super().reset()


@odd(r"cannot be created")
class MakingRaises(Plain):
    def __init__(self, render_mode=None):
        raise OSError("no licence")


@odd(r"it cannot be created: making it raised AssertionError at `assert version >= 3` \(failures\.py:\d+\)")
class MakingAssertsWithoutWords(Plain):
    def __init__(self, render_mode=None):
        version = 2
        assert version >= 3


@odd(r"step\(\) raised RuntimeError at `raise RuntimeError` \(failures\.py:\d+\)")
class StepRaisesWithoutWords(Plain):
    def reward(self):
        raise RuntimeError


@odd(r"tried to end the program")
class MakingExits(Plain):
    def __init__(self, render_mode=None):
        sys.exit(3)


@odd(r"its constructor needs 'level'; give it in the block, as options =")
class MakingNeedsArgument(Plain):
    def __init__(self, level, render_mode=None):
        super().__init__(render_mode)


@odd(r"its constructor takes no width, which its registration gives", kwargs={"width": 9})
class MakingWithAnotherArgument(Plain):
    pass


@odd(r"render\(\) is not implemented")
class PictureNotImplemented(Plain):
    def render(self):
        raise NotImplementedError


@odd(r"its constructor takes no render_mode; write def __init__")
class MakingWithoutRenderMode(Plain):
    def __init__(self):
        super().__init__()


@odd(r"cannot be created")
class NoEnvironment:
    def __init__(self, render_mode=None):
        pass


@odd(r"its metadata is no dict; set it to")
class MetadataNone(Plain):
    metadata = None  # type: ignore[assignment]


@odd(r"no render mode 'rgb_array'")
class MetadataEmpty(Plain):
    metadata = {}  # noqa: RUF012


@odd()
class CloseRaises(Plain):
    def close(self):
        raise OSError("window is gone")


@odd()
class CloseExits(Plain):
    def close(self):
        sys.exit()


@odd()
class Prints(Plain):
    def move(self, action):
        super().move(action)
        print("reward shaping is on")


@odd()
class Warns(Plain):
    def move(self, action):
        super().move(action)
        gymnasium.logger.warn("this is deprecated")


@odd(r"its code needs the module 'module_of_nobody', which is not installed; install the package that has it")
class NeedsAModule(Plain):
    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        import module_of_nobody  # noqa: F401


@odd(r"step\(\) raised AttributeError: dict has no energy \(failures.py:\d+\); if .* another version of a package")
class StepNeedsAnotherVersion(Plain):
    def move(self, action):
        super().move({}.energy)
