"""Progress and tables in the terminal, and their silence where nobody looks."""

from __future__ import annotations

from rich.console import Console

from simloop.common.terminal import compiling, print_table, progress_bar


def printed(draw):
    console = Console(width=40, force_terminal=False)
    with console.capture() as capture:
        draw(console)
    return capture.get()


def test_tables_keep_their_columns_however_narrow_the_terminal():
    rows = [["a", "x" * 60], ["long name", "y"]]
    lines = printed(lambda console: print_table(console, "t", ["name", "what"], rows)).splitlines()
    assert lines[0] == "t" and lines[1].index("what") == lines[2].index("x") == lines[3].index("y")


def test_compiling_is_said_once_and_only_if_it_happens():
    def compile_kernels(names):
        def draw(console):
            with compiling(console) as report:
                for count, name in enumerate(names, start=1):
                    report(name, count)

        return draw

    assert printed(compile_kernels([])) == ""
    assert printed(compile_kernels(["one", "two"])).count("compiling") == 1
    console = Console(force_terminal=True, width=120)
    with console.capture() as capture:
        compile_kernels(["one", "two"])(console)
    assert "compiling kernel" in capture.get()


def test_no_bar_where_nobody_looks():
    def draw(console):
        with progress_bar(console, 5.0, 60.0) as progress:
            progress(1.0, 4.0)

    assert printed(draw) == ""
    console = Console(force_terminal=True, width=120)
    with console.capture() as capture:
        draw(console)
    assert "1.0 s simulated" in capture.get() and "4.00 m to go" in capture.get()
