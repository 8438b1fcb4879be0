"""Ablations of soundness: does an audit predict how well a reward trains a policy?"""
