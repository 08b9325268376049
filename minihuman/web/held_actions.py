"""How keys that are held, axes and named actions make a step's action, for a page that computes the steps itself."""

from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.web.held_messages import HeldInputs, HeldRules, VectorRules
from minihuman.worlds.adapters.spaces import DiscreteActions


def describe_vectors(play: RunningEpisode) -> VectorRules | None:
    """Return how named actions and axes make a vector; None in a world whose actions are numbers."""
    actions = play.world.actions
    if isinstance(actions, DiscreteActions):
        return None
    low, high = actions.bounds
    return VectorRules(
        elements=[(element.component, element.value) for element in actions.elements],
        rest=list(actions.rest),
        low=list(low),
        high=list(high),
        adds=list(actions.adds),
        whole=list(actions.is_whole),
    )


def describe_held(play: RunningEpisode) -> HeldRules | None:
    """Return how held keys and axes combine into an action; None in an episode in which each press makes one step."""
    if not play.repeats_held:
        return None
    actions = play.world.actions
    chords = actions.chords if isinstance(actions, DiscreteActions) else {}
    axes = {axis: (binding.component, binding.scale) for axis, binding in play.axis_bindings.items()}
    return HeldRules(axes, [(sorted(keys), action) for keys, action in chords.items()])


def find_held(play: RunningEpisode) -> HeldInputs | None:
    """Return the keys and axes that the session considers held; None in an episode in which they do not combine."""
    if not play.repeats_held:
        return None
    down, pressed, axes = play.held_inputs
    return HeldInputs(list(down), list(pressed), axes)
