from minihuman.runtime.watch.running_sessions import ThrottledCall


def test_what_takes_long_takes_a_small_share_of_the_time() -> None:
    now_s, found = [0.0], []

    def find() -> int:
        now_s[0] += 0.2
        found.append(now_s[0])
        return len(found)

    seldom = ThrottledCall(find, share=0.05, clock=lambda: now_s[0])
    told = []
    while now_s[0] < 100:
        told.append(seldom())
        now_s[0] += 1
    assert told[0] == 1
    assert told == sorted(told)
    assert 20 <= len(found) <= 25
    assert len(found) * 0.2 <= 0.05 * 100 + 0.2
