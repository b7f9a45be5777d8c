"""HTML of pages: escaping, Content-Security-Policy, script, explanations and size."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from slamgauge.compare.report.page import ASSETS, MODULES, json_text, pack, plain_page, program, render
from slamgauge.compare.report.run_page import closure_table
from slamgauge.compare.scoring.table import Cell, Head, Table

from .conftest import unexplained

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


def test_the_page_of_a_run_explains_every_column(run_page: Path) -> None:
    assert unexplained(run_page) == []


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
    text = render("base.html", kind="k", title="a\x1bb\udcff", origin=[])
    assert r"a\x1bb\udcff" in text
    assert text.encode()


def test_columns_are_explained_once_and_only_for_tables_with_rows() -> None:
    found, left = Head("found", help="the likeliest value"), Head("left", help="what is not shown")
    row = [Cell("1")]
    tables = [Table([found], [row], "A"), Table([found], [row], "B"), Table([left], [], "C")]
    text = plain_page(kind="k", title="t", lead=[], tables=tables, origin=[])
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
