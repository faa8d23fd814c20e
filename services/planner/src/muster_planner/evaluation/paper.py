"""What the DART-LLM paper reports, on 102 instructions of its own: table "Evaluation of DART-LLM and SMART-LLM"."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Reported:
    """One line of the paper's table: (SR, IPA, DSR, SGSR, RTR) of L1, L2 and L3."""

    model: str
    l1: tuple[float, float, float, float, float]
    l2: tuple[float, float, float, float, float]
    l3: tuple[float, float, float, float, float]


_ONES = (1.0, 1.0, 1.0, 1.0)

REPORTED = (
    Reported("DART-LLM (Llama3.1)", (*_ONES, 0.96), (0.85, 1, 0.85, 0.90, 0.90), (0.84, 0.93, 0.84, 0.88, 0.86)),
    Reported("DART-LLM (GPT-3.5-turbo)", (*_ONES, 0.75), (0.87, 1, 0.87, 0.87, 0.68), (0.8, 0.97, 0.85, 0.80, 0.66)),
    Reported("DART-LLM (GPT-4o)", (*_ONES, 0.55), (0.96, 1, 0.96, 0.96, 0.50), (0.93, 1, 0.93, 0.93, 0.45)),
    Reported("DART-LLM (Claude3.5)", (*_ONES, 0.70), (0.90, 1, 0.90, 0.95, 0.63), (0.86, 1, 0.86, 0.90, 0.60)),
    Reported("DART-LLM (DeepSeek-r1)", (*_ONES, 0.30), (0.97, 1, 0.97, 0.97, 0.25), (0.94, 1, 0.94, 0.94, 0.20)),
    Reported("SMART-LLM (Llama3.1)", (*_ONES, 0.24), (0.36, 0.57, 0.46, 0.36, 0.19), (0.24, 0.37, 0.43, 0.24, 0.16)),
    Reported("SMART-LLM (DeepSeek-r1)", (*_ONES, 0.08), (0.78, 0.78, 0.91, 0.87, 0.04), (0.65, 0.65, 0.86, 0.78, 0.02)),
)  # fmt: skip

ABLATION_L3 = {"Llama3.1": (0.84, 0.45), "GPT-4o": (0.93, 0.85), "DeepSeek-r1": (0.94, 0.89)}
"""SR of L3 with and without dependencies, as far as the paper's text says them."""
