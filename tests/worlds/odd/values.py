"""Odd in what reset and step return: tuples, rewards, flags and infos."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
from gymnasium import spaces

from tests.worlds.odd.plain import Plain, odd


@odd(r"reset\(\) returned an array of shape .*; it must return \(observation, info\)")
class ResetWithoutInfo(Plain):
    def reset(self, **options):
        return super().reset(**options)[0]


@odd(r"reset\(\) returned nothing \(None\)")
class ResetNone(Plain):
    def reset(self, **options):
        super().reset(**options)


@odd(r"reset\(\) returned a tuple of 3 values")
class ResetThree(Plain):
    def reset(self, **options):
        return (*super().reset(**options), {})


@odd(r"reset\(\) returned nothing \(None\) as info; return a dict")
class ResetInfoNone(Plain):
    def reset(self, **options):
        return super().reset(**options)[0], None


@odd(r"step\(\) returned a tuple of 4 values.*done divided into terminated and truncated")
class FourValues(Plain):
    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, info


@odd(r"did not return what Gymnasium asks for", max_episode_steps=30)
class FourValuesInTimeLimit(FourValues):
    pass


@odd(r"step\(\) returned nothing \(None\)")
class StepNone(Plain):
    def step(self, action):
        super().step(action)


@odd(r"step\(\) returned a tuple of 6 values; .* a cost, in info")
class SixValues(Plain):
    def step(self, action):
        return (*super().step(action), 0)


@odd(r"step\(\) returned a dict of 5 values")
class StepDict(Plain):
    def step(self, action):
        return dict(zip("orudi", super().step(action), strict=True))


@odd()
class StepList(Plain):
    def step(self, action):
        return list(super().step(action))


@odd(r"the reward is nan at step 7")
class RewardNaN(Plain):
    def reward(self):
        return float("nan") if self.count == 7 else 0.0


@odd(r"the reward is inf at step 4")
class RewardInfinite(Plain):
    def reward(self):
        return float("inf") if self.count == 4 else 0.0


@odd(r"the reward must be one number and is nothing \(None\)")
class RewardNone(Plain):
    def reward(self):
        return None if self.count == 4 else 0.0


@odd(r"the reward must be one number and is an array of shape \(1,\)")
class RewardArray(Plain):
    def reward(self):
        return np.ones(1)


@odd(r"the reward must be one number and is an array of shape \(2,\)")
class RewardVector(Plain):
    def reward(self):
        return np.zeros(2)


@odd(r"the reward must be one number and is a list of 2 values; .* of several agents")
class RewardOfAgents(Plain):
    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        self.action_space = spaces.Tuple([spaces.Discrete(3)] * 2)
        self.observation_space = spaces.Tuple([self.observation_space] * 2)

    def observe(self):
        return (super().observe(),) * 2

    def reward(self):
        return [0.0, 1.0]


@odd(r"the reward must be one number and is the text '1.0'")
class RewardText(Plain):
    def reward(self):
        return "1.0"


@odd(r"the reward must be one number and is an object of the class complex")
class RewardComplex(Plain):
    def reward(self):
        return 1 + 2j


@odd(r"the reward must be one number and is a dict")
class RewardDict(Plain):
    def reward(self):
        return {"agent": 1.0}


@odd(r"the reward must be one number and is the number 1000")
class RewardHuge(Plain):
    def reward(self):
        return 10**400


@odd(unexportable="beyond the float32 of RLDS|has no square, of which")
class RewardBeyondFloat32(Plain):
    def reward(self):
        return 1e300


@odd()
class RewardInteger(Plain):
    def reward(self):
        return 1


@odd()
class RewardFlag(Plain):
    def reward(self):
        return True


@odd()
class RewardFloat16(Plain):
    def reward(self):
        return np.float16(0.1)


@odd()
class RewardZeroDimensional(Plain):
    def reward(self):
        return np.array(0.5)


@odd()
class RewardFraction(Plain):
    def reward(self):
        return Fraction(1, 3)


@odd()
class RewardDecimal(Plain):
    def reward(self):
        return Decimal("0.1")


@odd(r"terminated must be True or False and is the text 'False'")
class TerminatedText(Plain):
    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, str(terminated), truncated, info


@odd(r"terminated must be True or False and is an array of shape \(2,\)")
class TerminatedVector(Plain):
    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, reward, np.array([terminated, terminated]), truncated, info


@odd(r"truncated must be True or False and is the number 0.5")
class TruncatedHalf(Plain):
    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, 0.5, info


@odd()
class TerminatedNumpy(Plain):
    def step(self, action):
        observation, reward, terminated, truncated, info = super().step(action)
        return observation, np.float32(reward), np.bool_(terminated), np.array([truncated]), info


@odd()
class TruncatedNone(Plain):
    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, None, info


@odd()
class BothFlags(Plain):
    def step(self, action):
        observation, reward, terminated, _, info = super().step(action)
        return observation, reward, terminated, terminated, info


@odd(r"step\(\) returned a list of 1 values as info; return a dict")
class InfoList(Plain):
    def step(self, action):
        return (*super().step(action)[:4], ["info"])


@odd()
class InfoGrows(Plain):
    def info(self):
        return {f"key_{number}": number for number in range(self.count)}


@odd()
class InfoOfArrays(Plain):
    def info(self):
        return {"array": np.zeros(3), 7: {1, 2}, "self": self, None: object}


@odd(r"info\['onset'\] must be True or False and is an array of shape \(3,\)")
class OnsetVector(Plain):
    def info(self):
        return {"onset": np.zeros(3)}


@odd()
class OnsetFlag(Plain):
    def info(self):
        return {"onset": np.bool_(self.count % 3 == 0)}
