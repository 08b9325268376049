"""The inputs that may lead on from a screen, by name."""

from collections.abc import Callable, Iterator

from minihuman.experiment.machine.inputs import Input, KeyDown, PointerPressed
from minihuman.experiment.machine.screens import (
    OptionList,
    PageScreen,
    QuestionScreen,
    RatingMatrix,
    RatingScale,
    Slider,
    TextScreen,
)
from minihuman.experiment.machine.session import SessionMachine


def list_inputs(session: SessionMachine) -> Iterator[tuple[str, Callable[[int], Input]]]:
    """Yield the name of each input that may lead on from a session's screen, and a function that makes the input."""
    names: list[str] = []
    match session.screen:
        case TextScreen(keys=keys):
            names = ["key:enter", *(f"key:{key}" for key, _ in keys)]
        case PageScreen(buttons=buttons):
            names = [*_KEYS_OF_PAGES, *(f"point:{button.name}" for button in buttons)]
        case QuestionScreen(item=Slider(), buttons=buttons):  # whose other keys move the thumb
            names = ["key:enter", "key:tab", *(f"point:{button.name}" for button in buttons)]
        case QuestionScreen(item=item, buttons=buttons):
            names = ["key:enter", "key:tab", "key:page_up", *(f"point:{button.name}" for button in buttons)]
            names += _list_answers(item)
    for name in names:
        yield name, build_input_maker(name)
        if name == "key:enter":
            yield "key:kp_enter", build_input_maker("key:kp_enter")


_KEYS_OF_PAGES = ("key:enter", "key:right", "key:left", "key:space", "key:page_down", "key:page_up")


def _list_answers(widget: object) -> list[str]:
    """Return the names of the inputs that may change the answer in a widget: keys, and clicks on its options."""
    names = [f"key:{key}" for key in ("up", "down", "left", "right", "space")]
    n_options = 0
    match widget:
        case OptionList(options=options):
            n_options = len(options)
        case RatingScale(points=points):
            n_options = len(points)
        case RatingMatrix(rows=rows, points=points):
            n_options = len(rows) * len(points)
    digits = range(1, min(9, n_options) + 1)  # only the first nine options have a key
    names += [f"key:{digit}" for digit in digits]
    names += [f"key:kp_{digit}" for digit in digits]
    names += [f"point:option:{number}" for number in range(n_options)]
    return names


def build_input_maker(name: str) -> Callable[[int], Input]:
    """Return a function that makes the input with a name, such as "key:enter" or "point:go_on", at a time in ns."""
    kind, _, target = name.partition(":")
    if kind == "point":
        return lambda t_ns: PointerPressed(t_ns, 0.5, 0.5, target, 0.5)  # in the middle of the picture and the target
    return lambda t_ns: KeyDown(t_ns, target, target)
