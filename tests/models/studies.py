"""Studies that a scripted model plays."""

STUDY = """
[study]
name = "seat"
version = "1"
seed = 4
participants = 200
consent = "You agree to take part."
[model]
modality = "{modality}"
invalid = "{invalid}"
history = 2
price_prompt = 1.0
price_completion = 2.0
currency = "EUR"
provider = "scripted"
{model}
[keys]
pool = ["1", "2", "3"]
[[groups]]
name = "all"
parts = ["walk", "after"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 4
episodes = 2
instructions = "Find the green square."
feedback = "{{outcome}}"
show_outcome = true
{block}
[[questions]]
name = "after"
title = "About"
[[questions.items]]
name = "hard"
kind = "choice"
ask = "Was it hard?"
options = ["yes", "no"]
[[questions.items]]
name = "which"
kind = "choices"
ask = "What did you use?"
options = ["eyes", "luck"]
[[questions.items]]
name = "said"
kind = "text"
ask = "What did you do?"
[[questions.items]]
name = "fun"
kind = "likert"
ask = "Was it fun?"
low = "no"
high = "yes"
[[questions.items]]
name = "how_much"
kind = "slider"
ask = "How much?"
low = "none"
high = "all"
[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
"""


def study(modality: str = "both", *, invalid: str = "retry", model: str = "", block: str = "") -> str:
    """A consent, two short episodes and a question of each kind."""
    return STUDY.format(modality=modality, invalid=invalid, model=model, block=block)
