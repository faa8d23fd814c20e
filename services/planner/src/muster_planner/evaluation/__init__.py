"""How well a model plans: cases with known answers, the scores of its plans, and what a paper would print of them."""
