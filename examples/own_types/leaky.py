"""Leaky: a network for `learn fit --network leaky`; by itself it is the program `learn`."""

import torch

import learn
from learn.__main__ import main


@learn.NETWORKS.register("leaky")
class Leaky(learn.Network):
    summary = "units that forget slowly"
    sizes = ("hidden",)

    def __init__(self, config):
        super().__init__(config)
        self.inner = torch.nn.Linear(config.inputs, config.hidden)
        self.keep = torch.nn.Parameter(torch.zeros(config.hidden))
        self.out = torch.nn.Linear(config.hidden, 1)
        self.state_size = config.hidden  # columns of the state

    def forward(self, x, state=None):  # (time, batch, inputs) to (time, batch, 1)
        state = self.initial_state(x.shape[1]) if state is None else state
        keep, rows = torch.sigmoid(self.keep), []
        for sample in torch.tanh(self.inner(x)):
            state = keep * state + (1 - keep) * sample
            rows.append(state)
        return self.out(torch.stack(rows)), state


if __name__ == "__main__":
    raise SystemExit(main())
