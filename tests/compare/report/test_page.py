"""HTML of pages: escaping, Content-Security-Policy, script, explanations and size."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.report.page import ASSETS, MODULES, Page, Section, json_text, pack, pages_of, program, render
from slamgauge.compare.report.run_pages import closure_table
from slamgauge.compare.report.study_pages import command_of_run
from slamgauge.compare.scoring.table import Cell, Head, Table
from slamgauge.compare.storage.staged_folder import begin_folder, decorate
from slamgauge.compare.studies.stored_study import load_study
from slamgauge.compare.studies.summary import Request, Summary
from slamgauge.errors import UserError

pytestmark = pytest.mark.slow

BARE = re.compile(r"^(?:export )?(?:async )?(?:function|class|const|let) +(\w+)", re.MULTILINE)
SOURCES = {name: (ASSETS / "modules" / f"{name}.js").read_text(encoding="utf-8") for name in MODULES}


class Elements(HTMLParser):
    """Start tags with their attributes, and the text within each kind of element."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self._within = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._within = tag

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self._within, []).append(data)


@pytest.fixture(scope="module")
def text(run_page: Path) -> str:
    return run_page.read_text(encoding="utf-8")


def test_a_page_of_the_first_run_has_at_most_three_megabytes(run_page: Path) -> None:
    assert run_page.stat().st_size <= 3_000_000


def test_user_given_names_are_escaped(text: str) -> None:
    found = Elements(text)
    scripts = [attributes for tag, attributes in found.tags if tag == "script"]
    assert [each["type"] for each in scripts] == ["application/json", "module"]
    assert "<script>alert(1)</script>, seed 0" in found.texts["h1"]
    assert 'own "<b>&amp;' in "".join(found.texts["th"])
    assert not [tag for tag, _ in found.tags if tag == "b"]
    assert not [name for _, attributes in found.tags for name in attributes if name == "style" or name.startswith("on")]


def test_the_policy_has_the_digests_of_script_and_style(text: str) -> None:
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)
    rules = dict(each.strip().split(" ", 1) for each in policy.replace("&#39;", "'").split(";"))
    assert rules["default-src"] == "'none'"
    assert "unsafe" not in policy
    for kind, rule in (("style", "style-src"), ('script type="module"', "script-src")):
        (inlined,) = re.findall(rf"<{kind}>(.*?)</{kind.split()[0]}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(inlined.encode()).digest()).decode()
        assert rules[rule] == f"'sha256-{digest}'"


def test_json_in_a_page_is_unchanged_and_cannot_end_an_element() -> None:
    data = {"name": "</script><!-- & \u2028", "list": [1.5, None]}
    text = json_text(data)
    assert json.loads(text) == data
    assert not set("<>&") & set(text)


def test_nan_in_json_is_an_error() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text({"figure": float("nan")})


def test_encoded_arrays_are_decoded_unchanged() -> None:
    values = np.array([[1.0, np.nan], [-2.5, 3e7]])
    packed = pack(values)
    read = np.frombuffer(base64.b64decode(packed["data"]), dtype="<f4").reshape(2, 2)
    np.testing.assert_array_equal(read, values)


def test_unprintable_characters_are_replaced_by_escapes() -> None:
    text = render(Page("k", "a\x1bb\udcff", [], []))
    assert r"a\x1bb\udcff" in text
    assert text.encode()


def test_columns_are_explained_once_and_only_for_tables_with_rows() -> None:
    found, left = Head("found", help="the likeliest value"), Head("left", help="what is not shown")
    row = [Cell("1")]
    tables = [Table([found], [row], "A"), Table([found], [row], "B"), Table([left], [], "C")]
    text = render(Page("k", "t", [], [], sections=[Section("a section", tables=tables), Section("an empty one")]))
    assert "<h2>a section</h2>" in text
    assert "an empty one" not in text
    assert text.count("<dd>the likeliest value</dd>") == 1
    assert "what is not shown" not in text


def test_modules_have_distinct_names_and_import_earlier_modules() -> None:
    assert {path.name for path in (ASSETS / "modules").iterdir()} == {f"{name}.js" for name in MODULES}
    names = [name for source in SOURCES.values() for name in BARE.findall(source)]
    assert len(names) == len(set(names))
    for place, (name, source) in enumerate(SOURCES.items()):
        assert source.startswith("// @ts-check\n/** "), f"{name}.js has a head comment"
        for imported, other in re.findall(r'^import \{ (.*) \} from "\./(\w+)\.js";$', source, re.MULTILINE):
            assert other in MODULES[:place]
            exported = set(re.findall(r"^export (?:function|class|const) (\w+)", SOURCES[other], re.MULTILINE))
            assert {*imported.split(", ")} <= exported


def test_the_script_has_no_imports_no_exports_and_no_eval() -> None:
    assert not re.findall(r"^(?:import|export) .*", program(), re.MULTILINE)
    assert not re.findall(
        r"\beval\b|new Function|innerHTML|insertAdjacentHTML|document\.write|fetch\(|https?:", program()
    )


def test_a_table_of_very_many_loop_closures_is_thinned_out() -> None:
    keys = ("error_before_m", "error_after_m", "sigma_before_m", "sigma_after_m")
    closures = [{"step": step, **dict.fromkeys(keys, 0.1)} for step in range(10_000)]
    table = closure_table({"estimators": {"ekf": {"loop_closure": closures}, "batch": {"loop_closure": None}}})
    assert len(table.rows) == 500
    assert "1 in 20 loop closures" in table.caption


def test_the_command_of_a_run_has_the_settings_of_the_study() -> None:
    request = Request("my map.toml", ("a.b=1", "c=[1, 2]"), "ekf,mine.py:f", "association.gate=4")
    summary = Summary("my map", 9, 0, "", (), {}, request=request)
    expected = "'my map.toml' --seed 7 --set a.b=1 'c=[1, 2]' association.gate=4 --estimators ekf,mine.py:f"
    assert command_of_run(summary, 7) == f"slamgauge run {expected}"
    assert "add the --set options of the study" in command_of_run(replace(summary, request=None), 7)


def test_a_page_of_other_results_is_refused_and_the_results_are_kept(
    page_of: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = page_of("study").parent
    begin_folder(tmp_path)
    (tmp_path / "study.sqlite").write_bytes((folder / "study.sqlite").read_bytes())
    summary = json.loads((folder / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps({**summary, "digest": "0" * 64}))
    (tmp_path / "budget.json").write_text("{}")
    for file, message in (
        ("summary.json", "has another study than the summary in this folder"),
        ("budget.json", "written by another version, or changed by hand"),
    ):
        main = tmp_path / file
        assert not decorate(tmp_path, {"report": lambda _, main=main: pages_of(main)}, file)
        assert message in capsys.readouterr().err
        assert main.exists()


def test_a_value_of_a_sweep_needs_the_stored_optimum(page_of: Callable[[str], Path], tmp_path: Path) -> None:
    folder = page_of("sweep").parent / "assumed.scale=2"
    assert [*load_study(folder).runs] == ["ekf", "causal"]
    for name in ("summary.json", "study.sqlite"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    with pytest.raises(UserError, match="has no run of causal; give the command of the study again"):
        load_study(tmp_path)
