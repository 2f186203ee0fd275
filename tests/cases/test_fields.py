import pytest

KIND = "fields of a task unchecked"
CODE = "T = move(DRUM)\n\ndef far(r):\n    return norm(r.object.pos)"


@pytest.mark.parametrize(
    ("brought", "returns", "says"),
    [
        ("a hold below 0", "replace(T, success_hold=-0.2)", "success_hold must be .* from 0"),
        ("a hold of nan", "replace(T, success_hold=float('nan'))", "success_hold must be a finite"),
        (
            "a hold as long as the episode",
            "replace(T, success_hold=30)",
            "success_hold, 30 s, is no",
        ),
        ("no end", "replace(T, time_limit=np.inf)", "time_limit must be a finite number, got inf"),
        ("a limit of nan", "replace(T, time_limit=np.nan)", "time_limit must be a finite number"),
        ("a limit of 0", "replace(T, time_limit=0)", "time_limit must be above 0 s, got 0"),
        ("a limit in quotes", "replace(T, time_limit='9')", "time_limit must be .*, got '9'"),
        (
            "a weight in quotes",
            "replace(T, cost=(CostTerm('far', far, '4'),))",
            "'far' must be .* '4'",
        ),
        (
            "a weight of -inf",
            "replace(T, cost=(CostTerm('far', far, -np.inf),))",
            "'far' must be a",
        ),
        ("a term that is none", "replace(T, cost=(far,))", "cost must be a tuple of CostTerm"),
        (
            "a residual that is none",
            "replace(T, cost=(CostTerm('far', 3.0, 1.0),))",
            "'far': its res",
        ),
        ("a name with =", "replace(T, cost=(CostTerm('a=b', far, 1.0),))", "'a=b': its name"),
        ("two terms of one name", "replace(T, cost=T.cost * 2)", "cost terms need distinct names"),
        ("two parameters of one name", "replace(T, parameters=T.parameters * 2)", "distinct names"),
        (
            "a default out of range",
            "Parameter('a', 3.0, 'm', (0.0, 1.0))",
            "'a' must be from 0 to 1",
        ),
        ("a default in words", "Parameter('a', 'much')", "'a' needs a finite number, got 'much'"),
        (
            "a range the wrong way",
            "Parameter('a', 0.5, 'm', (1.0, 0.0))",
            r"range must be \(low, high",
        ),
        ("a goal of two", "replace(T, goal=(1.0, 2.0))", r"goal must be \(x, y, z\)"),
        ("a goal of nan", "replace(T, goal=(1.0, np.nan, 0.0))", "y of its goal must be a finite"),
        ("a goal at a height of nan", "replace(T, goal=Goal('object', np.nan))", "z of its Goal"),
        (
            "a rest height of nan",
            "move(Manipuland('drum', 'drum.xml', np.nan))",
            "rest_z of object",
        ),
        ("a reset that is none", "replace(T, reset=None)", "reset must be a function, got None"),
        (
            "a success that is none",
            "replace(T, success=True)",
            "success must be a function, got True",
        ),
        (
            "a failure that is none",
            "replace(T, failure={'lost': 1})",
            "failure 'lost' must be a func",
        ),
        ("a frame called p", "replace(T, frames={**T.frames, 'p': T.frames['aim']})", "called 'p'"),
        (
            "a frame in words",
            "replace(T, frames={**T.frames, 'lid': 'lid'})",
            "'lid' must be a FrameRef",
        ),
    ],
)
def test_a_field_is_refused_by_name_and_line(ask, write_task, brought, returns, says):
    path = write_task(returns, CODE)
    line = path.read_text().splitlines().index(f"    return {returns}") + 1
    out = ask(KIND, brought, "task", "check", path, code=2, says=says)
    assert f"mine.py, line {line}: " in out
    assert len(out.splitlines()) == 1
