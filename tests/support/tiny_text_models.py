"""Open-vocabulary detectors of `transformers`, of the real classes but tiny, saved to a folder.

Their weights are random: they are loaded, given words and pictures, and read.
"""

import json

WORDS = ("cup", "coaster", "spoon", "hand", "red", "a", "photo", "of")


def save_owl(folder, *, side=64, patch=16, width=32, layers=1):
    """An OWLv2 with a vocabulary of single letters; the model and its processor."""
    import transformers

    torch_seed()
    letters = [chr(code) for code in range(ord("a"), ord("z") + 1)]
    tokens = [*letters, *(f"{letter}</w>" for letter in letters)]
    vocabulary = {token: at for at, token in enumerate([*tokens, "<|startoftext|>",
                                                        "<|endoftext|>"])}  # fmt: skip
    shape = {"hidden_size": width, "intermediate_size": 2 * width, "num_hidden_layers": layers}
    config = transformers.Owlv2Config(
        text_config=shape | {
            "vocab_size": len(vocabulary), "num_attention_heads": 2,
            "max_position_embeddings": 24, "bos_token_id": len(tokens),
            "eos_token_id": len(tokens) + 1, "pad_token_id": len(tokens) + 1,
        },
        vision_config=shape | {"image_size": side, "patch_size": patch, "num_attention_heads": 4},
        projection_dim=width,
    )  # fmt: skip
    model = transformers.Owlv2ForObjectDetection(config)
    for part in (model.box_head, model.class_head):  # whose own weights are of large models
        for linear in part.modules():
            if hasattr(linear, "reset_parameters"):
                linear.reset_parameters()
    folder.mkdir()
    (folder / "vocab.json").write_text(json.dumps(vocabulary))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = transformers.CLIPTokenizer.from_pretrained(folder, model_max_length=24,
                                                           pad_token="<|endoftext|>")  # fmt: skip
    pictures = transformers.Owlv2ImageProcessor(size={"height": side, "width": side})
    processor = transformers.Owlv2Processor(pictures, tokenizer)
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    return model, processor


def save_grounding(folder, kind="GroundingDino"):
    """A Grounding DINO, or with `MMGroundingDino` what LLMDet is."""
    import transformers

    torch_seed()
    listed = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", *WORDS]
    folder.mkdir()
    (folder / "vocab.txt").write_text("\n".join(listed) + "\n")
    tokenizer = transformers.BertTokenizer.from_pretrained(folder)
    config = getattr(transformers, f"{kind}Config")(
        backbone_config=transformers.SwinConfig(
            image_size=64, embed_dim=16, depths=[1, 1, 1, 1], num_heads=[2, 2, 2, 2],
            window_size=2, out_indices=[2, 3, 4],
        ),
        text_config=transformers.BertConfig(
            vocab_size=len(listed), hidden_size=32, num_hidden_layers=1, num_attention_heads=2,
            intermediate_size=32,
        ),
        d_model=32, encoder_layers=1, decoder_layers=2, num_queries=20, encoder_ffn_dim=32,
        decoder_ffn_dim=32, encoder_attention_heads=2, decoder_attention_heads=2, max_text_len=32,
    )  # fmt: skip
    model = getattr(transformers, f"{kind}ForObjectDetection")(config)
    pictures = transformers.GroundingDinoImageProcessor(
        size={"shortest_edge": 64, "longest_edge": 96}
    )
    processor = transformers.GroundingDinoProcessor(pictures, tokenizer)
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    return model, processor


def torch_seed():
    """The same random weights each time."""
    import torch

    torch.manual_seed(0)
