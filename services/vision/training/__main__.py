"""`python -m training` from `services/vision`: render, train, save, then evaluate on layouts never trained on."""

from . import evaluate, train

if __name__ == "__main__":
    train.main()
    evaluate.main()
