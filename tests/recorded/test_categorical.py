"""Texts kept once: a column of words is the texts it was made of, however it is cut and joined."""

from collections import Counter

import numpy as np
from hypothesis import given, strategies as st

from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.model.event_columns import CategoricalTexts, EventColumns

TEXTS = st.lists(st.sampled_from(["left", "right", "", "kp_8"]))


@given(st.lists(TEXTS, min_size=1), st.slices(10))
def test_words_are_the_texts_they_were_made_of(parts: list[list[str]], some: slice) -> None:
    joined = CategoricalTexts.joined([CategoricalTexts.of(part) for part in parts])
    texts = [text for part in parts for text in part]
    assert joined == texts
    assert tuple(texts) == joined
    assert joined[some] == texts[some]
    assert [joined[place] for place in range(len(texts))] == texts
    assert len(set(joined.categories)) == len(joined.categories)
    assert CategoricalTexts.of(joined) is joined
    assert joined != [*texts, "left"]


@given(TEXTS, st.data())
def test_chosen_places_are_counted_and_the_first_is_found(texts: list[str], data: st.DataObject) -> None:
    where = data.draw(st.lists(st.booleans(), min_size=len(texts), max_size=len(texts)))
    chosen = [place for place, is_chosen in enumerate(where) if is_chosen]
    words, mask = CategoricalTexts.of(texts), np.array(where, np.bool_)
    assert words.count_values() == Counter(texts)
    assert words.count_values(mask) == Counter(texts[place] for place in chosen)
    assert words.first_index(mask) == {texts[place]: place for place in reversed(chosen)}
    assert words.equals_any(("left", "kp_8")).tolist() == [text in ("left", "kp_8") for text in texts]


def test_a_part_knows_where_it_was_cut_from():
    pressed = EventColumns.of(
        KeyPressed, [KeyPressed(t, "a", "a", True, None, "unmapped", "playing") for t in range(9)]
    )
    some = pressed[2:8]
    assert (pressed.place(some), some.place(some[1:3]), some.place(some[6:])) == (slice(2, 8), slice(1, 3), slice(6, 6))
    assert list(pressed)[pressed.place(some[1:3])] == list(some[1:3])
