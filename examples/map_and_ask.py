"""The whole line from Python: map a recording, ask it, print the goal.

python examples/map_and_ask.py RECORDING DETECTOR "words"      (DETECTOR: FILE.onnx or ./mine.py)
"""

import sys

import cartier


def main(path: str, detector: str, words: str) -> None:
    eyes = (
        cartier.make("detectors", "onnx", model=detector)
        if detector.endswith(".onnx")
        else cartier.make("detectors", detector)
    )
    home = cartier.map_home(cartier.open_recording(path), eyes)
    answer = cartier.ask(home, words)
    print(answer.selection.status, answer.selection.object, "-", answer.selection.reason)
    if answer.place:
        print("place", [round(v, 2) for v in answer.place.position])
    if answer.goal:
        print(f"goal  x {answer.goal.x:.2f} m, y {answer.goal.y:.2f} m, yaw {answer.goal.yaw:.2f} rad")


if __name__ == "__main__":
    main(*sys.argv[1:4])
