"""Pages are laid out for a width: key columns stay, sentences go on in further lines, nothing is lost unsaid."""

from __future__ import annotations

from slamgauge.compare.scoring.text_page import Grid, Page, Tone

FIGURES = Grid([["estimator", "ATE [m]", "NEES"], ["ekf", "1.25", "3.1"], ["mine", "0.5", "failed"]])
SENTENCES = Grid([["no", "claim", "verdict"], ["1", "a gate that is too small maps more than there is", "holds"]], 3, 1)


def toned(text: str, tone: Tone) -> str:
    return text if tone == "plain" else f"<{tone}>{text}</{tone}>"


def test_a_page_without_a_width_is_whole():
    page = Page((FIGURES, "", "a line that is longer than the table under which it stands"))
    assert str(page).splitlines() == [
        "estimator  ATE [m]    NEES",
        "ekf           1.25     3.1",
        "mine           0.5  failed",
        "",
        "a line that is longer than the table under which it stands",
    ]


def test_columns_from_the_right_are_left_out_and_named():
    lines = Page((FIGURES, "words that go on")).text(24).splitlines()
    assert lines[:3] == ["estimator  ATE [m]", "ekf           1.25", "mine           0.5"]
    assert " ".join(line.strip() for line in lines[3:-1]) == "left out at 24 characters: NEES (--wide shows all)"
    assert lines[-1] == "words that go on"
    assert max(map(len, lines)) <= 24


def test_a_column_that_is_longer_than_its_title_is_left_out_too():
    grid = Grid([["rung", "adds", "for"], ["causal", "0.5", "for knowing only the past"]], words=(0, 2), sentences=2)
    lines = Page((grid,)).text(30).splitlines()
    assert lines[:2] == ["rung    adds", "causal   0.5"]
    assert max(map(len, lines)) <= 30
    assert Page((grid,)).text(36).splitlines() == [
        "rung    adds  for",
        "causal   0.5  for knowing only the",
        "              past",
    ]


def test_where_there_is_much_room_nothing_is_left_out():
    titles = [f"figure {place:02}" for place in range(40)]
    grid = Grid([["gate", "estimator", *titles], ["1", "ekf", *titles], ["9", "mine", *titles]], 2)
    lines = Page((grid,)).text(200).splitlines()
    heads = [line.split("  ") for line in lines if line.startswith("gate")]
    assert [head[:2] for head in heads] == [["gate", "estimator"]] * 3
    assert [title for head in heads for title in head[2:]] == titles
    assert max(map(len, lines)) <= 200
    assert not any("left out" in line for line in lines)
    assert "left out at 199 characters" in Page((grid,)).text(199)


def test_sentences_go_on_in_further_lines():
    lines = Page((SENTENCES,)).text(40).splitlines()
    assert lines == [
        "no  claim                     verdict",
        "1   a gate that is too small  holds",
        "    maps more than there is",
    ]


def test_no_line_ends_in_blanks():
    grid = Grid(
        [["noise", "verdict", "more"], ["forward", "any value below that of the log", "x" * 40]], 3, sentences=1
    )
    lines = Page((grid,)).text(40).splitlines()
    assert lines[0] == "noise    verdict"
    assert [line.rstrip() for line in lines] == lines


def test_long_names_lose_their_middle_where_the_width_is_limited():
    grid = Grid([["estimator", "ATE [m]"], ["a_name_of_many_characters/and_more:of_them", "1.0"], ["b", "2.0"]])
    assert Page((grid,)).text(40).splitlines()[1] == "a_name_of_ma...more:of_them      1.0"
    assert "many_characters" in str(Page((grid,)))


def test_tones_leave_the_layout_as_it_is():
    assert Page((SENTENCES,)).text(40, toned).splitlines()[1] == "1   a gate that is too small  <good>holds</good>"
    told = Page((FIGURES,)).text(None, toned).splitlines()
    assert (told[0], told[2]) == ("<head>estimator  ATE [m]    NEES</head>", "mine           0.5  <bad>failed</bad>")


def test_notebooks_show_tables_and_escape_names():
    shown = Page((Grid([["estimator"], ["<b>"]]), "", "a & b")).html()
    assert shown.splitlines() == [
        '<div style="overflow-x: auto"><table><thead><tr><th>estimator</th></tr></thead>'
        '<tbody><tr><td style="white-space: nowrap">&lt;b&gt;</td></tr></tbody></table></div>',
        "",
        "<p>a &amp; b</p>",
    ]
