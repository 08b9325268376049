"""Contract test of learners.

The same data and seed give the same policy, the inputs are not changed, and the returned settings reproduce a run that
a time limit ended.
"""

import json
from collections.abc import Callable
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np

from minihuman.errors import LearnError, MinihumanError
from minihuman.testing.checks import require
from minihuman.worlds.adapters.world import World

if TYPE_CHECKING:  # PyTorch is imported only where a learner is checked
    from minihuman.learn.policy.network import Policy
    from minihuman.learn.teaching.dataset import Dataset, Lesson
    from minihuman.learn.teaching.learner import Learner, LearningResult

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
EPISODES = 6
MAX_STEPS = 20
N_ACTIONS = 3
STEP_NS = 600 * 10**6  # between pictures
DELAY_NS = 500 * 10**6  # from a picture to the press that rates it
SHORT_S = 0.05  # so short that a learner of many updates does not finish


def check_learner(make: "str | Callable[[str], Learner]", settings: str = "", dataset: "Dataset | None" = None) -> None:
    """Run a learner several times on the same data, and compare the policies.

    Args:
        make: the learner's registered name, or its class.
        settings: the text after the colon, such as ``updates=20``; few updates make a quick check.
        dataset: the data to learn from; by default, a small dataset that has demonstrations, a takeover, ratings and
            comparisons.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        LearnError: if the learner cannot learn from the dataset.
    """
    from minihuman.learn.teaching.learner import make_fresh_policy

    dataset = dataset or build_teaching_dataset()
    start = make_fresh_policy(dataset, np.random.default_rng(5))
    dataset_sha256 = dataset.sha256()
    start_weights = _flatten_weights(start)
    for policy in (None, start):
        first = _learn(make, settings, dataset, policy, noise=1)
        second = _learn(make, settings, dataset, policy, noise=2)
        require(
            np.array_equal(_flatten_weights(first.policy), _flatten_weights(second.policy)),
            "the same data and seed gave other weights; it draws from something else than request.rng",
        )
        is_unchanged = np.array_equal(start_weights, _flatten_weights(start))
        require(is_unchanged, "learn() changed request.policy; copy it with copy_policy")
        require(dataset.sha256() == dataset_sha256, "learn() changed request.dataset")
    stopped = _learn(make, settings, dataset, None, noise=3, budget_s=SHORT_S)
    stopped_settings = ",".join(f"{name}={setting}" for name, setting in stopped.settings.items())
    reproduced = _learn(make, stopped_settings, dataset, None, noise=4)
    require(
        np.array_equal(_flatten_weights(stopped.policy), _flatten_weights(reproduced.policy)),
        f"after {SHORT_S} s it returned the settings {stopped.settings}, which give another policy without a limit",
    )
    _check_empty_dataset(make, settings, dataset)


def build_teaching_dataset() -> "Dataset":
    """Return a small dataset with demonstrations, a takeover, ratings and comparisons in a grid world."""
    from minihuman.learn.policy.observation import ObservationEncoder
    from minihuman.learn.teaching.dataset import Comparison, Dataset, LessonFragment, LessonRating

    with closing(World(WORLD)) as world:
        world.reset(0)
        eyesight = ObservationEncoder(missions=False)
        empty = Dataset(WORLD, {}, world.action_names[:N_ACTIONS], MAX_STEPS, eyesight, eyesight.space(world.unwrapped))
        lessons = [_play_lesson(world, empty, number) for number in range(EPISODES)]
    ratings = []
    for lesson in lessons:
        for t_ns, by_person in zip(lesson.shown_ns[1:], lesson.by_person[:-1], strict=True):
            rating = 1.0 if by_person else -1.0
            ratings.append(LessonRating(int(t_ns) + DELAY_NS, rating, lesson.name))
    good = lessons[0].name
    bad = lessons[-1].name
    pairs = [Comparison(LessonFragment(good, k, k + 1), LessonFragment(bad, k, k + 1), "left") for k in range(3)]
    return empty.with_more(lessons, ratings, pairs)


def _play_lesson(world: World, dataset: "Dataset", number: int) -> "Lesson":
    """Play the episode of a given number, with the planner in the person's place, and return it as a lesson.

    In odd-numbered episodes a policy makes the first four steps, in which it turns on the spot.
    """
    from minihuman.learn.teaching.dataset import NO_QUERY, Lesson

    n_by_policy = 4 if number % 2 else 0
    images, actions, rewards = _play_episode(world, dataset, number, n_by_policy)
    n_steps = len(actions)
    policy_action = 0 if n_by_policy else NO_QUERY
    probabilities = None
    if n_by_policy:
        probabilities = np.full((n_steps, N_ACTIONS), 1 / N_ACTIONS, np.float32)
    participant = f"sub-{number % 2 + 1:02}"
    return Lesson(
        name=f"{participant}_ses-01:{number + 1}",
        participant=participant,
        seed=number,
        observations={"image": np.stack(images)},
        actions=np.array(actions, np.int64),
        by_person=np.arange(n_steps) >= n_by_policy,
        policy_actions=np.full(n_steps, policy_action, np.int64),
        # a picture every STEP_NS; each episode has the time of MAX_STEPS pictures
        shown_ns=(number * MAX_STEPS + np.arange(n_steps, dtype=np.int64)) * STEP_NS,
        rewards=np.array(rewards),
        policy_probabilities=probabilities,
    )


def _play_episode(
    world: World, dataset: "Dataset", seed: int, n_by_policy: int
) -> tuple[list[Any], list[int], list[float]]:
    """Play an episode to its end: action 0 for the first ``n_by_policy`` steps, then the shortest path.

    Returns:
        The image before each step, the actions, and the rewards.
    """
    world.reset(seed)
    encoder = dataset.eyesight.episode_encoder()
    images = []
    actions: list[int] = []
    rewards: list[float] = []
    is_over = False
    while not is_over:
        images.append(encoder.encode(world.unwrapped, world.observation)["image"])
        path = world.shortest_path()
        assert path
        action = 0
        if len(actions) >= n_by_policy:
            action = world.action_names.index(path[0])
        transition = world.step(action)
        actions.append(action)
        rewards.append(transition.reward)
        is_over = transition.terminated or transition.truncated
    return images, actions, rewards


def _make_learner(make: "str | Callable[[str], Learner]", settings: str) -> "Learner":
    """Return the learner that ``make`` names or makes from the text ``settings``, after checking its type."""
    from minihuman.learn.teaching.learner import Learner, make_learner

    if isinstance(make, str):
        learner = make_learner(f"{make}:{settings}")
    else:
        learner = make(settings)
    require(isinstance(learner, Learner), f"{type(learner).__name__} is not a minihuman.ext.Learner")
    return learner


def _learn(
    make: "str | Callable[[str], Learner]",
    settings: str,
    dataset: "Dataset",
    policy: "Policy | None",
    *,
    noise: int,
    budget_s: float = float("inf"),
) -> "LearningResult":
    """Run a learner once and return its result, checked; ``noise`` seeds the global streams, which must not matter."""
    import torch

    from minihuman.learn.policy.network import Policy
    from minihuman.learn.teaching.learner import LearningRequest, LearningResult, copy_policy

    learner = _make_learner(make, settings)
    state = np.random.get_state()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(noise)
        np.random.seed(noise)
        try:
            result = learner.learn(LearningRequest(dataset, np.random.default_rng(1), policy, budget_s))
        except MinihumanError:
            raise
        except Exception as error:
            require(
                False, f"learn() raised {type(error).__name__}: {error}; in a study its policy before would play on"
            )
        finally:
            np.random.set_state(state)
    require(isinstance(result, LearningResult), f"learn() gave a {type(result).__name__}, not a LearningResult")
    require(isinstance(result.policy, Policy), f"its policy is a {type(result.policy).__name__}, not a Policy")
    try:
        copy_policy(result.policy, dataset)
    except LearnError as error:
        require(False, f"its policy cannot play the dataset's world ({error}); begin with make_fresh_policy")
    require(bool(np.isfinite(_flatten_weights(result.policy)).all()), "a weight of its policy is not finite")
    _require_json(result.settings, "settings")
    _require_json(result.notes, "notes")
    return result


def _require_json(values: dict[str, Any], field: str) -> None:
    """Require that ``values``, the field of the result that ``field`` names, can be written as JSON."""
    try:
        json.dumps(values)
    except TypeError as error:
        require(False, f"{field} cannot be written into the policy's file ({error}); use numbers, text and lists")


def _check_empty_dataset(make: "str | Callable[[str], Learner]", settings: str, dataset: "Dataset") -> None:
    """Check that the learner raises a LearnError for a dataset without lessons."""
    from dataclasses import replace

    from minihuman.learn.teaching.learner import LearningRequest

    empty_dataset = replace(dataset, lessons=(), ratings=(), comparisons=())
    try:
        _make_learner(make, settings).learn(LearningRequest(empty_dataset, np.random.default_rng(1)))
    except LearnError:
        return
    except Exception as error:
        require(False, f"without a lesson it raised {type(error).__name__}: {error}; raise a LearnError")
    require(False, "without a lesson it returned a policy; raise a LearnError")


def _flatten_weights(policy: "Policy") -> np.ndarray[Any, Any]:
    """Return all weights of a policy as one vector."""
    return np.concatenate([tensor.detach().cpu().numpy().ravel() for tensor in policy.state_dict().values()])
