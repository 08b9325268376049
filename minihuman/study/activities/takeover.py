"""Takeover: the agent plays at a pace; any key that has an action takes over at once, and one key hands back."""

from minihuman.study.activities.agent_events import Who
from minihuman.study.activities.agent_plan import AgentPlayPlan
from minihuman.study.activities.agent_play import AgentPlaying
from minihuman.study.activities.port import Kind
from minihuman.study.inputs import KeyDown


class Takeover(AgentPlaying):
    """Whoever pressed last steers: the person until they hand back, then the agent."""

    takes_over = True

    def _key_in_play(self, press: KeyDown) -> None:
        play, say_key = self._current, self.stage.say_key
        action = play.action_of(press.key)
        if press.key == self.agent.hand_back and not press.repeat:
            can = self.who == "person" and bool(self.policy)
            say_key(press, "accepted" if can else "not_playing", self.phase)
            if can:
                self._steer("agent", "hand_back", press.t_ns)
        elif action is None or (press.repeat and not play.plan.auto_repeat):
            super()._key_in_play(press)
        else:
            say_key(press, "accepted", self.phase, action)
            if self.who == "agent":
                self._steer("person", "key", press.t_ns)
            self._step(action, key=press.key, key_t_ns=press.t_ns)

    @property
    def hand_back_key(self) -> str:
        """The key that gives the agent control back; "" where there is no agent to give it to."""
        return self.agent.hand_back if self.policy else ""

    def said_of(self, who: Who) -> str:
        """What is said below the picture while somebody steers; with it how a person hands back."""
        words, said = self.stage.words, super().said_of(who)
        if who == "agent" or not self.policy:
            return said
        key = words.labels((self.agent.hand_back,))[0][1]
        return f"{said}  {words.fill('steers.hand_back', name=key)}"


TAKEOVER = Kind("takeover", AgentPlayPlan, Takeover, messages="minihuman.log.agent:TAKEOVER")
