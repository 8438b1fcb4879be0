"""Files of boxes that are wrong: beside a.mp4, of five frames of 200 x 100 pixels, or a_1.txt in a
folder; and words of the sentence that says so."""

W, H = 200, 100
NAMES = ("cup", "hand")
HEAD = "frame,class,x_min,y_min,x_max,y_max"
XML = '<annotations><track id="0" label="cup">{}</track></annotations>'
BOX = '<box frame="0" outside="0" xtl="1" ytl="1" xbr="9" ybr="9"/>'
COCO = '{"images": [{"id": 1}], "categories": [{"id": 1, "name": "cup"}], "annotations": [%s]}'
STUDIO = (
    '[{"data": {"video": "a.mp4"}, "annotations": [{"result": [{"type": "videorectangle", %s}]}]}]'
)
ENTITIES = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>\n' + XML.format("&b;")
WRONG = {
    "nothing": ("a.csv", "", "is empty"),
    "spaces": ("a.txt", " \n \n", "is empty"),
    "prose": ("a.txt", "dear reader,\n", "line 1: the format of the boxes is not known"),
    "not UTF-8": ("a.csv", b"\xff\xfe\x00", "not text in UTF-8"),
    "CSV without a column": ("a.csv", "frame,class,x_min\n", "line 1: the column 'y_min'"),
    "CSV with a column twice": ("a.csv", f"{HEAD},frame\n", "line 1: the column 'frame' is there"),
    "CSV without boxes": ("a.csv", f"{HEAD}\n", "holds no box"),
    "CSV with a short row": ("a.csv", f"{HEAD}\n0,cup,1,1\n", "line 2: 4 cells where 6"),
    "CSV with NaN": ("a.csv", f"{HEAD}\n0,cup,1,1,nan,9\n", "line 2: x_max must be a number"),
    "CSV with infinity": ("a.csv", f"{HEAD}\n0,cup,1,1,inf,9\n", "line 2: x_max must be a number"),
    "CSV, a box of 10^29 pixels": (
        "a.csv", f"{HEAD}\n0,cup,1,1,1e29,9\n", "line 2: x_max is 1e+29, but a.mp4 is 200 x 100"
    ),
    "CSV with words": ("a.csv", f"{HEAD}\n0,cup,left,1,9,9\n", "line 2: x_min must be a number"),
    "CSV turned over": ("a.csv", f"{HEAD}\n0,cup,9,1,1,9\n", "line 2: a box needs x_min < x_max"),
    "CSV beyond the video": ("a.csv", f"{HEAD}\n5,cup,1,1,9,9\n", "line 2: frame 5 is beyond a,"),
    "CSV before the video": ("a.csv", f"{HEAD}\n-1,cup,1,1,9,9\n", "line 2: frame must be a whole"),
    "CSV without a class": ("a.csv", f"{HEAD}\n0, ,1,1,9,9\n", "a class must be a name"),
    "CSV, class of 99 letters": ("a.csv", f"{HEAD}\n0,{'x' * 99},1,1,9,9\n", "a class must"),
    "CSV, class with a bell": ("a.csv", f"{HEAD}\n0,cu\ap,1,1,9,9\n", "a class must"),
    "CSV with an id twice": (
        "a.csv", f"{HEAD},track\n0,cup,1,1,9,9,4\n0,cup,5,5,9,9,4\n", "line 3: a second box"
    ),
    "CSV, endless cell": ("a.csv", f'{HEAD}\n0,"{"x" * 200_000}\n', "line 2: not CSV text"),
    "MOT with 5 columns": ("a.txt", "1,1,1,1,9,9,1,cup\n1,2,3,4,5\n", "line 2: 5 columns"),
    "MOT from -1": ("a.txt", "-1,1,1,1,9,9,1,cup\n", "line 1: frame must be a whole number from 0"),
    "MOT without names": ("a.txt", "1,1,1,1,9,9,1,3\n", "class 3 is a number"),
    "MOT of no width": ("a.txt", "1,1,1,1,0,9,1,cup\n", "line 1: a box needs x_min < x_max"),
    "XML with entities": ("a.xml", ENTITIES, "line 1: a document type is not allowed"),
    "XML cut short": ("a.xml", XML.format(BOX)[:-9], "line 1: not whole XML"),
    "other XML": ("a.xml", "<svg></svg>", "without <annotations>"),
    "CVAT for images": ("a.xml", "<annotations>\n<image/></annotations>", "line 2: <image> is of"),
    "CVAT of another size": (
        "a.xml",
        f"<annotations><original_size><width>640</width></original_size>{BOX}</annotations>",
        "line 1: the width is 640, but a.mp4 is 200 x 100",
    ),
    "CVAT without an edge": ("a.xml", XML.format('<box frame="0" xtl="1"/>'), "has no 'ytl'"),
    "CVAT without a label": ("a.xml", XML.replace('label="cup"', "").format(BOX), "a class must"),
    "XML without boxes": ("a.xml", XML.format(""), "holds no box"),
    "JSON cut short": ("a.json", '{"images": [\n', "line 2: not JSON"),
    "JSON, nested deeply": ("a.json", "[" * 100_000, "nested too deeply"),
    "JSON, number without end": ("a.json", "[" + "9" * 5000 + "]", "or a number has thousands of"),
    "COCO without categories": ("a.json", "{}", "the field 'categories' is missing"),
    "COCO of no image": (
        "a.json", COCO % '{"image_id": 7, "category_id": 1, "bbox": [1, 1, 8, 8]}',
        "annotation 0: image_id 7 is not among the images",
    ),
    "COCO of no category": ("a.json", COCO % '{"category_id": 5}', "category_id 5 is not among"),
    "COCO, three numbers": (
        "a.json", COCO % '{"image_id": 1, "category_id": 1, "bbox": [1, 1, 8]}', "bbox must be"
    ),
    "Label Studio of others": ("a.json", '[{"data": {"v": "b.mp4"}}, {"data": {}}]', "no task is"),
    "Label Studio, unfinished": ("a.json", '[{"data": {}, "annotations": []}]', "nobody has"),
    "Label Studio, two labels": (
        "a.json", STUDIO % '"value": {"labels": ["a", "b"], "sequence": []}', "needs one label"
    ),
    "Label Studio, no key": ("a.json", STUDIO % '"value": {"labels": ["a"]}', "'sequence' is"),
    "YOLO without a number": ("a/boxes.txt", "0 0.5 0.5 0.1 0.1", "must end with"),
    "YOLO in pixels": ("a/a_1.txt", "0 50 50 10 10", "line 1: lengths must be shares"),
    "YOLO, empty folder": ("a/readme.md", "", "holds no file like NAME_1.txt"),
    "YOLO, unknown class": ("a/a_1.txt", "7 0.5 0.5 0.1 0.1", "line 1: class 7 is not among the 2"),
}  # fmt: skip
