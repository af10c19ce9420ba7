"""Equations of plain text as MathML: well formed, with everything that the text has."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from haptogram_paper.equations import EQUATIONS
from haptogram_paper.mathml import equation_mathml

TEXTS = [text for e in EQUATIONS for text in (e.printed, e.corrected) if "=" in text]
WRITTEN = str.maketrans({"−": "-", "π": "pi", "ρ": "rho", "β": "beta", "α": "alpha", "φ": "phi"})


@pytest.mark.parametrize("text", TEXTS)
def test_every_equation_of_the_paper_is_well_formed_and_whole(text: str) -> None:
    root = ElementTree.fromstring(equation_mathml(text))
    for tag, children in {"mfrac": 2, "msup": 2, "msub": 2, "msubsup": 3, "msqrt": 1}.items():
        assert all(len(node) == children for node in root.iter(tag))
    shown = "".join(root.itertext()).translate(WRITTEN)
    shown = shown.replace("λ", "lambda").replace("θ", "theta")
    shown = shown.replace("∑", "sum").replace("∫", "int")
    # Fractions, roots, groups and indices are drawn, not written.
    plain = re.sub(r"sqrt|[\s/^_{}()]", "", text)
    assert re.sub(r"[()]", "", shown) == plain


@pytest.mark.parametrize(
    ("text", "inner"),
    [
        ("a = b c / d e", "<mfrac><mrow><mi>b</mi><mi>c</mi></mrow><mi>d</mi></mfrac><mi>e</mi>"),
        ("a = b c/(d e)", "<mi>b</mi><mfrac><mi>c</mi><mrow><mi>d</mi><mi>e</mi></mrow></mfrac>"),
        ("a = P0^2", "<msup><msub><mi>P</mi><mn>0</mn></msub><mn>2</mn></msup>"),
        ("a = p_rms^2", "<msubsup><mi>p</mi><mi>rms</mi><mn>2</mn></msubsup>"),
    ],
)
def test_what_a_fraction_and_an_index_belong_to(text: str, inner: str) -> None:
    assert equation_mathml(text) == f"<math><mi>a</mi><mo>=</mo>{inner}</math>"


def test_words_are_no_equation_and_escaped() -> None:
    assert equation_mathml("as <printed>") == "as &lt;printed&gt;"
