from eclsim.paper.comparison import Check, Explanation, within
from eclsim.validation import suite
from eclsim.validation.robustness import Effort


def test_parts_run_in_the_order_asked_and_are_announced_before(monkeypatch):
    events = []

    def part(name):
        def compute(effort):
            events.append(("computed", name, effort.points))
            return [Check(name, name, "none", (within("a", 1.0, 1.0, 0.1),))]

        return compute

    monkeypatch.setattr(suite, "PARTS", {name: part(name) for name in ("one", "two", "three")})
    found = list(suite.run(Effort(points=8), ["three", "one"], lambda name: events.append(("told", name))))
    assert [check.key for check in found] == ["three", "one"]
    assert all(check.seconds > 0.0 for check in found)
    assert events == [("told", "three"), ("computed", "three", 8), ("told", "one"), ("computed", "one", 8)]


def test_all_parts_run_if_none_is_named(monkeypatch):
    monkeypatch.setattr(suite, "PARTS", {name: lambda effort: [] for name in "ab"})
    told = []
    assert list(suite.run(Effort(), announce=told.append)) == []
    assert told == ["a", "b"]


def test_the_summary_counts_fits_tests_and_verdicts_apart_and_gives_each_reason_once():
    shown = Explanation("the flow was another", (within("with it", 1.0, 1.0, 0.1),))
    unknown = Explanation("the flow is not printed", (within("with one", 1.0, 1.0, 0.1),), undecided=True)
    failed = Explanation("with half of it the row holds", (within("with half", 1.0, 2.0, 0.1),))
    rows = (
        within("a (fit)", 1.0, 1.0, 0.1),
        within("b (test)", 1.0, 2.0, 0.1, explanation=shown),
        within("c (test)", 1.0, 3.0, 0.1, explanation=shown),
        within("d (test)", 1.0, 3.0, 0.1, explanation=unknown),
        within("e (test)", 1.0, 3.0, 0.1),
        within("f (test)", 1.0, 1.0, 0.1),
        within("g (test)", 1.0, 3.0, 0.1, explanation=failed),
    )
    text = suite.validation_markdown([Check("key", "title", "bar", rows, required=False)])
    assert "| title | bar | 1 of 1 | 1 of 6 | 2 | 1 | 2 |" in text
    assert "| key | c (test) | 1 | 3 | +200 % | miss, explained | 1 |" in text
    assert "| key | d (test) | 1 | 3 | +200 % | not decidable | 2 |" in text
    assert "| key | e (test) | 1 | 3 | +200 % | MISS |  |" in text
    assert "| key | g (test) | 1 | 3 | +200 % | MISS |  |" in text, "its experiment does not show the reason"
    assert text.endswith("1. the flow was another\n2. the flow is not printed\n")
