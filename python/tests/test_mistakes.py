"""What is refused carries code, place and hint."""

from __future__ import annotations

import inspect
import itertools
import textwrap
from pathlib import Path

import numpy as np
import pytest
from conftest import DECAY, decaying

import fdm

# Text, code, line, column, and a part of message or hint
WRONG = [
    ("model m {\n  state x = 1;\n  der(x) = -k*x;\n  output y = x;\n}", "E0201", 3, 13, "`k`"),
    ("model m {\n  state x = 1; param kappa = 1;\n  der(x) = -kapa*x; output y = x; }", "E0201", 3, 13, "kappa"),
    ("model m {\n  state x = 1;\n  state x = 2; der(x) = 1; output y = x; }", "E0202", 3, 9, "`x`"),
    ("model m { state x = 1; der(x) = sine(x); output y = x; }", "E0204", 1, 33, "sin"),
    ("model m { state x = 1; der(x) = sin(x, x); output y = x; }", "E0205", 1, 33, "sin"),
    ("model m { let a = b; let b = a; output y = a; }", "E0206", 1, 15, "b"),
    ("model m { param k; output y = k; }", "E0301", 1, 17, "k"),
    ("model m { param k = 1 in [3, 2]; output y = k; }", "E0303", 1, 23, "3"),
    ("model m { param k = 9 in [1, 2]; output y = k; }", "E0304", 1, 21, "9"),
    ("model m { state x = 1; output y = x; }", "E0401", 1, 17, "x"),
    ("model m { state x = 1; der(x) = 1; der(x) = 2; output y = x; }", "E0402", 1, 36, "x"),
    ("model m { state x = 1; der(x) = 1; }", "E0404", 1, 7, "output"),
    ("model m { state x [m] = 1; param a = 1 [s]; der(x) = a + x; output y = x; }", "E0602", 1, 56, "s"),
    ("model m { state x [metr] = 1; der(x) = 1; output y = x; }", "E0601", 1, 20, "metr"),
    ("model m { state x = 1; der(x) = ; output y = x; }", "E0101", 1, 33, ""),
    ("model m { state x = 1; der(x) = 1 output y = x; }", "E0101", 1, 34, ""),
    ("model m { state x = 1; der(x) = (1; output y = x; }", "E0104", 1, 33, "`)`"),
    ('model m { use "none.fdm" as n; output y = n.y; }', "E0801", None, None, "none.fdm"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "code", "line", "column", "part"), WRONG)
def test_mistakes_of_a_text(text, code, line, column, part):
    with pytest.raises(fdm.ModelError) as caught:
        fdm.Model.from_text(text, "m.fdm")
    error = caught.value
    assert error.code == code and error.file == "m.fdm", error
    if line is not None:
        assert (error.line, error.column) == (line, column)
    assert part in error.message + (error.hint or "")
    assert f"[{code}]" in str(error) and error.diagnostics[0].title


# Every kind of input, what is wrong with it, and code, place and hint of the exception: the place as a part of it
def mistakes(roll: fdm.Model, decay: fdm.Model, folder: Path):
    run, t = decaying(), np.linspace(0, 8, 20)

    def text(body):
        return lambda: fdm.Model.from_text(body, "m.fdm")

    def file(content, **options):
        def read():
            (folder / "run.csv").write_text(content)
            decay.fit(fdm.Run.read(folder / "run.csv", **options))

        return read

    def samples(**given):
        return lambda: decay.fit(fdm.Run(t=t, **given))

    return [
        (text("model m {\n  state x = 1; param kappa = 1;\n  der(x) = -kapa*x; output y = x; }"), "E0201", "m.fdm:3:13", "kappa"),
        (text("model m { state x = 1; der(x) = sine(x); output y = x; }"), "E0204", "m.fdm:1:33", "sin"),
        (text("model m { state x [metr] = 1; der(x) = 1; output y = x; }"), "E0601", "m.fdm:1:20", ""),
        (text("model m { param k; output y = k; }"), "E0301", "m.fdm:1:17", "k"),
        (text("model m { state x = 1; output y = x; }"), "E0401", "m.fdm:1:17", "der(x)"),
        (text("model m { state x = 1; der(x) = 1; der(x) = 2; output y = x; }"), "E0402", "m.fdm:1:36", ""),
        (text("model m { state x = 1; der(x) = 1; }"), "E0404", "m.fdm:1:7", "output"),
        (text("model m { state x = 1; der(x) = (1; output y = x; }"), "E0104", "m.fdm:1:33", ""),
        (lambda: fdm.Model(folder / "none.fdm"), "unreadable", "none.fdm", None),
        (file("t [s],y\n0,1\n1,abc\n2,0.5\n"), "record", "run.csv:3: y", ""),
        (file("t [s],yy\n0,1\n1,2\n2,0.5\n"), "record", "run.csv", "yy"),
        (file("t [s],y\n0,1\n2,1\n1,0.5\n"), "record", "run.csv:4", ""),
        (file("t [m],y\n0,1\n1,1\n2,0.5\n"), "record", "run.csv", ""),
        (file(""), "record", "run.csv", ""),
        (lambda: decay.fit(folder / "none.csv"), "record", "none.csv", ""),
        (file("t [s],y\n0,1\n1,1\n2,0.5\n", evry=2), "unknown_option", "evry", "every"),
        (samples(outputs={"yy": t}), "run", "run `run`", "`y`"),
        (samples(outputs={"y": t[:3]}), "run", "run `run`", ""),
        (samples(outputs={"y": (t, "m")}), "run", "run `run`", ""),
        (samples(outputs={"y": np.where(t > 4, np.inf, t)}), "run", "run `run`", ""),
        (lambda: decay.fit(fdm.Run(t=t[::-1], outputs={"y": t})), "run", "run `run`", ""),
        (lambda: decay.fit(run, metod="output-error"), "unknown_option", "metod", "method"),
        (lambda: decay.fit(run, method="output-eror"), "option", "output-eror", "output-error"),
        (lambda: decay.fit(run, loss="hubber"), "option", "hubber", "huber"),
        (lambda: decay.fit(run, fix="kk"), "input", "kk", "`k`"),
        (lambda: decay.fit(run, noise={"yy": 1}), "input", "noise", "`y`"),
        (lambda: decay.fit(run, coherence=0.5), "input", "coherence", "frequency-response"),
        (lambda: decay.diagnose(run, only="input_dely"), "input", "input_dely", "input_delay"),
        (lambda: decay.profile(run, "kk"), "input", "parameter", "`k`"),
        (lambda: decay.study(run, noise_colour="purple"), "option", "purple", "pink"),
        (lambda: fdm.load(folder / "none"), "input", None, ""),
    ]  # fmt: skip


@pytest.mark.parametrize("number", range(31))
def test_every_mistake_has_code_place_and_hint(roll, decay, tmp_path, number):
    call, code, place, hint = mistakes(roll, decay, tmp_path)[number]
    with pytest.raises(fdm.Error) as caught:
        call()
    error = caught.value
    assert error.code == code and (place is None or place in str(error.place)), (error.code, error.place)
    # an empty hint of the table stands for a sentence that says itself what is expected
    assert hint is None or hint in (error.hint or str(error)), error.hint
    assert not hint or error.hint, str(error)


def test_all_mistakes_come_at_once():
    with pytest.raises(fdm.ModelError) as caught:
        fdm.Model.from_text("model m { state x = 1; der(x) = a; output y = b; }")
    assert [d.excerpt for d in caught.value.diagnostics] == ["a", "b"]
    assert str(caught.value.diagnostics[1]).startswith("model.fdm:1:47: error[E0201]")


def test_models_in_python_tell_their_own_line():
    with pytest.raises(fdm.ModelError) as caught:
        fdm.model(
            """
            model m { state x = 1;
              der(x) = -kk*x;
              output y = x; }
            """
        )
    source = open(__file__).read().splitlines()
    assert caught.value.file == __file__
    assert source[caught.value.line - 1][caught.value.column - 1 :].startswith("kk")
    made = fdm.model("model good { param a = 1; output y = a; }")
    assert made.name == "good" and made.file == "model.fdm"


def test_warnings_of_a_text_are_warned_of_at_their_place():
    with pytest.warns(fdm.ModelWarning, match=r"W\d{4}"):
        m = fdm.Model.from_text("model m { param a = 1, b = 2; output y = a; }")
    assert m.warnings[0].code.startswith("W") and not m.warnings[0].error


def test_cells_tell_their_line(capsys):
    shell = pytest.importorskip("IPython.core.interactiveshell").InteractiveShell.instance()
    shell.run_line_magic("load_ext", "fdm")
    shell.run_cell("%%fdm decay\n" + DECAY)
    assert shell.user_ns["decay"].name == "decay"
    shell.run_cell("%%fdm wrong\nmodel m {\n  state x = 1;\n  der(x) = -k*x;\n  output y = x; }")
    said = capsys.readouterr().err
    assert "<cell>:4" in said and "E0201" in said and "wrong" not in shell.user_ns


# Call, exception, and a part of what is said
def refusals(roll: fdm.Model, decay: fdm.Model):
    run = decaying()
    return [
        (lambda: decay.fit(run, metod="output-error"), fdm.UnknownOption, "did you mean `method`"),
        (lambda: decay.fit(run, out="x"), fdm.UnknownOption, "`out` is an option of the command alone"),
        (lambda: decay.fit(run, method="output-eror"), fdm.OptionError, "output-error"),
        (lambda: decay.fit(run, fix="kk"), fdm.InputError, "did you mean `k`"),
        (lambda: decay.fit(run, set={"kk": 1}), fdm.InputError, "did you mean `k`"),
        (lambda: decay.fit(run, coherence=0.5), fdm.InputError, "`coherence` cannot be combined with `method` output-error"),
        (lambda: decay.fit(run, noise={"yy": 1}), fdm.InputError, "did you mean `y`"),
        (lambda: decay.fit(run, steps=0), fdm.OptionError, "steps"),
        (lambda: decay.fit(run, loss="hubber"), fdm.OptionError, "huber"),
        (lambda: decay.fit([]), fdm.InputError, "no run was given"),
        (lambda: decay.simulate(run, {"kk": 1}), fdm.InputError, "kk"),
        (lambda: decay.diagnose(run, only="input_dely"), fdm.InputError, "input_delay"),
        (lambda: decay.extend("input_delay(u)"), fdm.InputError, "fits nowhere"),
        (lambda: decay.spectra(run), fdm.InputError, "no input"),
        (lambda: decay.profile(run, "kk"), fdm.InputError, "did you mean `k`"),
        (lambda: decay.study(run, noise_colour="purple"), fdm.OptionError, "pink"),
        (lambda: decay.changed(free="kk"), fdm.InputError, "kk"),
        (lambda: decay.changed(untie="k"), fdm.InputError, "not tied"),
        (lambda: fdm.Model("no such file.fdm"), fdm.UnreadableError, "no such file.fdm"),
        (lambda: fdm.load("no such folder"), fdm.InputError, "no such folder"),
        (lambda: decay.fit("no such file.csv"), fdm.RecordError, "no such file.csv"),
    ]  # fmt: skip


@pytest.mark.parametrize("number", range(21))
def test_refusals(roll, decay, number):
    call, kind, part = refusals(roll, decay)[number]
    with pytest.raises(kind) as caught:
        call()
    assert part in str(caught.value) and "--" not in str(caught.value)


def test_files_with_mistakes_have_line_and_column(decay, tmp_path):
    file = tmp_path / "run.csv"
    file.write_text("t [s],y\n0,1\n1,abc\n2,0.5\n")
    with pytest.raises(fdm.RecordError) as caught:
        decay.fit(file)
    error = caught.value
    assert (error.file, error.line, error.column) == (str(file), 3, "y") and "abc" in error.problems[0].message


def test_numbers_that_go_wrong_are_told(decay):
    m = fdm.Model.from_text("model m { state x = 1; param k = 1; der(x) = k*x*x; output y = x; }")
    run = fdm.Run(t=np.linspace(0, 3, 50), outputs={"y": np.ones(50)})
    with pytest.raises(fdm.NumericalError, match="not finite at time"):
        m.prepare(run).r([5.0])
    with pytest.warns(fdm.ResultWarning, match="diverges"):
        assert np.isnan(m.simulate(run, {"k": 5.0})["y"]).any()


def test_nothing_is_printed(capfd, decay, tanker, tanker_run):
    decay.fit(decaying())
    tanker.fit(tanker_run)
    with pytest.raises(fdm.Error):
        decay.fit("no such file.csv")
    assert capfd.readouterr() == ("", "")


def test_examples_of_docstrings_are_python():
    for name in fdm.__all__:
        doc = inspect.cleandoc(getattr(fdm, name).__doc__ or "")
        for part in doc.split("::\n\n")[1:]:
            lines = itertools.takewhile(lambda line: line.startswith("    ") or not line.strip(), part.splitlines())
            compile(textwrap.dedent("\n".join(lines)), name, "exec")


def test_everything_public_is_documented():
    for name in fdm.__all__:
        thing = getattr(fdm, name)
        assert name == "__version__" or (thing.__doc__ or "").strip(), name
        if isinstance(thing, type):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                    assert (value.__doc__ or "").strip(), f"{name}.{member}"


