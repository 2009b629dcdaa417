from eclsim.paper.comparison import Check, within
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
