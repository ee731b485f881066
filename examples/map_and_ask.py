"""The whole pipeline from Python: map a recording, ask the home, print the goal.

python examples/map_and_ask.py RECORDING DETECTOR "words"      (DETECTOR: FILE.onnx or ./mine.py)
"""

import sys

import cartier


def main(path: str, model: str, words: str) -> None:
    if model.endswith(".onnx"):
        detector = cartier.make("detectors", "onnx", model=model)
    else:
        detector = cartier.make("detectors", model)
    home = cartier.map_home(cartier.open_recording(path), detector)
    answer = cartier.ask(home, words)
    chosen = answer.selection
    print(chosen.status, chosen.object or chosen.question or chosen.text, "-", chosen.reason)
    if answer.place is None:  # nothing serves, the robot asks back, or it answers in words
        return
    print("place", [round(metres, 2) for metres in answer.place.middle])
    if answer.goal is None:  # there is no depth, or no pose near it can be reached
        print("no goal:", *answer.notes)
        return
    print(f"goal  x {answer.goal.x:.2f} m, y {answer.goal.y:.2f} m, yaw {answer.goal.yaw:.2f} rad")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except cartier.CartierError as error:
        sys.exit(f"cartier: {error}")
