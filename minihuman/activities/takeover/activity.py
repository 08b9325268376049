"""Takeover: an agent plays a block, and the person takes control by a key and returns it by another."""

from minihuman.activities.agent_blocks.activity import AgentPlayActivity
from minihuman.activities.agent_blocks.events import Controller
from minihuman.activities.agent_blocks.plan import AgentPlayPlan
from minihuman.activities.agent_blocks.rules import check_block
from minihuman.experiment.machine.activity import ActivityKind
from minihuman.experiment.machine.inputs import KeyDown


class TakeoverActivity(AgentPlayActivity):
    """An activity in which the person takes control from an agent by a key and returns it by the hand-back key."""

    takes_over = True

    def _key_in_play(self, press: KeyDown) -> None:
        """Handle a key press during an episode: hand control back, or make a step and take control with it."""
        play = self._current
        emit_key = self.context.emit_key
        action = play.action_of(press.key)
        if press.key == self.agent.hand_back and not press.repeat:
            if self.controller == "person" and self.policy:
                emit_key(press, "accepted", self.phase)
                self._steer("agent", "hand_back", press.t_ns)
            else:
                emit_key(press, "not_playing", self.phase)
        elif action is None or (press.repeat and not play.plan.auto_repeat):
            super()._key_in_play(press)
        else:
            emit_key(press, "accepted", self.phase, action)
            if self.controller == "agent":
                self._steer("person", "key", press.t_ns)
            self._step(action, key=press.key, key_t_ns=press.t_ns)

    @property
    def hand_back_key(self) -> str:
        """Return the key that returns control to the agent; "" if there is no agent to return it to."""
        if self.policy:
            return self.agent.hand_back
        return ""

    def control_text(self, controller: Controller) -> str:
        """Return the text below the picture, which says who is in control and which key hands control back."""
        words = self.context.words
        text = super().control_text(controller)
        if controller == "agent" or not self.policy:
            return text
        key_label = words.labels((self.agent.hand_back,))[0][1]
        return f"{text}  {words.fill('steers.hand_back', name=key_label)}"


TAKEOVER = ActivityKind(
    "takeover",
    AgentPlayPlan,
    TakeoverActivity,
    messages="minihuman.activities.agent_blocks.rows:AGENT_ROWS",
    tables="minihuman.activities.agent_blocks.tables:AGENT_TABLES",
    check_block=check_block,
    report="minihuman.activities.agent_blocks.report:build_section",
    simulator="minihuman.activities.agent_blocks.simulation:AgentBlockSimulator",
)
