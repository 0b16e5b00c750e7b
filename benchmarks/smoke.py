"""A short run of some benchmarks on generated data: ``python -m benchmarks.smoke``."""

from __future__ import annotations

from benchmarks import growth, page, peers, priors, quality, rowwise, tiles
from benchmarks.captures import synthetic


def main() -> None:
    """Run each benchmark on small pictures. Exit with 1 if an alternative returns another picture than rsdeblur."""
    print(quality.run([synthetic()])["markdown"])
    print(rowwise.summary(rowwise.run(peers.QUICK_SIZE, 1, 1)))
    small = priors.middle(synthetic(noise=0.0), (96, 72))
    print(priors.run([small], situations=priors.SITUATIONS[-1:])["markdown"])
    print(tiles.run([synthetic(noise=0.0)], tiles.TILES[:2]))
    beside = peers.run(peers.QUICK_SIZE, peers.QUICK_LARGE, 1, [1])
    grown = growth.run(growth.QUICK, 1, 1)
    for record in (beside, grown):
        record["command"] = "python -m benchmarks.smoke"
    print(page.page(beside, grown))
    peers.refuse_other_pictures(beside)


if __name__ == "__main__":
    main()
