"""URScript programs in the emulator, valid and invalid."""

import hypothesis.strategies as st
import pytest
from hypothesis import given

from drivers.ur.emulator.urscript import MAX_STEPS, MAX_THREADS, Program
from drivers.ur.emulator.urscript_parser import MAX_CHARS, parse
from drivers.ur.emulator.urscript_values import PoseValue, ScriptError


class Robot:
    """Records the output of programs."""

    def __init__(self):
        self.outputs = []


def say(thread, value, more=""):
    thread.robot.outputs.append(value)


def sync(thread):
    yield


def twice(thread, value, scale=1):
    yield
    return 2 * value * scale


def to_str(thread, value):
    return str(value)


KNOWN = {"to_str": to_str, "say": say, "sync": sync, "twice": twice}


def run(body, cycles=20):
    """Output of a program within so many cycles."""
    robot = Robot()
    text = "def main():\n" + body + "\nend\n"
    program = Program(parse(text, KNOWN), robot)
    try:
        for _ in range(cycles):
            if not program.step():
                break
    finally:
        program.close()
    return robot.outputs


# reading


def test_a_comment_may_separate_sign_and_value():
    """ur_rtde's upload has that: its register offsets are filled in on the next line."""
    body = "global a = # offset\n0    global b = # offset\n24\nsay(a)\nsay(b)"
    assert run(body) == [0, 24]


def test_invalid_programs_are_refused():
    for text in [
        "def f(:\nend",
        "def f():\n",
        "x = ",
        "f(a=1, 2)",
        "x = [1, 2",
        "if x:\nend end",
        'x = "open',
        "x = 1 $ 2",
        "x = a.b",
        "x = f(__class__)()",
        "\x00",
    ]:
        with pytest.raises(ScriptError):
            parse(text, KNOWN)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("say('a')", "line 2: a string is in double quotes: say('a')"),
        ("def f():\nend\ndef f():\nend", "line 4: f is defined already: def f():"),
        ("thread main():\nend", "line 2: main is defined already: thread main():"),
        ("def say():\nend", "line 2: say is defined already: def say():"),
    ],
)
def test_a_refusal_names_the_line(body, message):
    with pytest.raises(ScriptError) as error:
        parse(f"def main():\n{body}\nend\n", KNOWN)
    assert str(error.value) == message


def test_excessive_programs_are_refused():
    for text in [
        "x = " + "(" * 10_000 + "1" + ")" * 10_000,
        "x = " + "-" * 10_000 + "1",
        "if 1:\n" * 10_000,
        "x = 1" + " + 1" * 100_000,
        "x = a" + "[0]" * 100_000,
        "x = " + "9" * 100_000,
        "x = 4294967296",
        " " * (MAX_CHARS + 1),
    ]:
        with pytest.raises(ScriptError):
            parse(text, KNOWN)


@given(st.text(st.sampled_from('ab p[](),=+-*"#\n:1.5endifwhiltru'), max_size=200))
def test_any_text_is_parsed_or_refused(text):
    try:
        parse(text, KNOWN)
    except ScriptError as error:
        assert str(error)


# running


def test_expressions_have_their_values():
    for expression, value in [
        ("1 + 2 * 3", 7),
        ("-2 + 5 % 3", 0),
        ("(1 + 2) * 3 / 2", 4.5),
        ("1 < 2 and not 3 >= 4", True),
        ("False or 1 == 1.0", True),
        ('"a"', "a"),
        ('"it\'s"', "it's"),
        ("p[1, 2, 3, 4, 5, 6]", PoseValue([1, 2, 3, 4, 5, 6])),
        ("[1, [2][0]]", [1, 2]),
        ("2147483647", 2147483647),
    ]:
        (outputs,) = run(f"say({expression})")
        assert outputs == value and type(outputs) is type(value), (expression, value)


def test_functions_scopes_and_copies():
    body = """
      global shared = 1
      def change(q):
        q[0] = 9
        own = 5
        shared = shared + own
        return q
      end
      q = [1, 2]
      r = change(q)
      say(q)
      say(r)
      say(shared)
    """
    assert run(body) == [[1, 2], [9, 2], 6]


def test_loops_branches_and_functions_that_wait():
    body = """
      def count(n):
        i = 0
        while True:
          i = i + 1
          if i == 2:
            continue
          elif i > n:
            break
          else:
            say(i)
          end
          sync()
        end
        return i
      end
      say(count(4) + twice(3, scale=2))
    """
    assert run(body) == [1, 3, 4, 17]


def test_threads_are_started_killed_and_kept_waiting():
    body = """
      global n = 0
      thread counter():
        while True:
          n = n + 1
          sync()
        end
      end
      handle = run counter()
      sync()
      sync()
      enter_critical
      before = n
      sync()
      sync()
      say(n - before)
      exit_critical
      kill handle
      sync()
      before = n
      sync()
      say(n - before)
      say(before > 0)
    """
    assert run(body) == [0, 0, True]


def test_programs_with_unknown_names_do_not_start():
    for body in [
        "__import__(1)",
        "say(\N{MATHEMATICAL BOLD SMALL T}hread)",  # Python reads it as thread
        "say(f'{thread}')",
        "say(lambda: 1)",
        "say([thread for thread in [1]])",
        "say(unknown)",
        "x = unknown_function()",
        "say(1, nonsense=2)",
        "say(thread=2)",
        "twice(1, 2, 3)",
        "def f(a):\n end\n f()",
    ]:
        with pytest.raises(ScriptError):
            parse("def main():\n" + body + "\nend", KNOWN)


def test_run_time_errors_end_a_program():
    for body, message in [
        ("while True:\n x = 1\n end", "infinite loop detected"),
        ("while True:\n end", "infinite loop detected"),
        ("while True:\n i = 0\n while i < 600:\n i = i + 1\n end\n end", "infinite loop"),
        ("x = 1\n" * (MAX_STEPS + 1), "infinite loop detected"),
        ("if False:\n end\n" * (MAX_STEPS // 2) + "x = 1\n" * (MAX_STEPS // 2), "infinite loop"),
        (
            f"thread t():\n i = 0\n while i < {MAX_STEPS // 6}:\n i = i + 1\n end\n end\n"
            " h = run t()\n h = run t()\n h = run t()\n sync()",
            "infinite loop",
        ),
        ("def f():\n f()\n end\n f()", "too deep"),
        ("x = 2147483647\n x = x + 1", "overflow"),
        ("x = -2147483647 - 1\n x = -x", "overflow"),
        ("x = 1 / 0", "ZeroDivisionError"),
        ("x = [1][1]", "out of range"),
        ("x = [1][0.0]", "index"),
        ("x = [1]\n x = [x, x]", "list"),
        ("x = p[0,0,0,0,0,0]\n x[0] = True\n x[0] = [1]", "list"),
        ('x = "a" * 100000', "number"),
        ('x = "a" + "a"', "number"),
        ("if False:\n x = 1\n end\n say(x)", "no value"),
        (
            f"thread t():\n sync()\n end\n i = 0\n while i < {MAX_THREADS + 1}:\n h = run t()\n"
            " i = i + 1\n end",
            "too many threads",
        ),
    ]:
        with pytest.raises(ScriptError, match=message):
            run(body)
